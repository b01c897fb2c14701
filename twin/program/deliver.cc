#include <cstdio>

#include <tribotwin/twin/program/program.hpp>

namespace tribotwin::twin::program {

int deliver(const std::string& text, const std::string& file) {
  if (file.empty()) {
    std::fwrite(text.data(), 1, text.size(), stdout);
    return std::fflush(stdout) == 0 ? done : complain(failed, "stdout cannot be written");
  }
  const auto written = write_file(file, text);
  return written ? done : complain(failed, written.error());
}

}  // namespace tribotwin::twin::program
