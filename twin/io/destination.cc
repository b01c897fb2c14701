#include <tribotwin/twin/io/destination.hpp>
#include <tribotwin/twin/io/output.hpp>

namespace tribotwin::twin {

Result<void> Destination::check(const std::vector<std::filesystem::path>& inputs) const {
  return named() ? check_output(file, existing(), inputs) : Result<void>{};
}

int Destination::deliver(std::string_view program, std::string_view text) const {
  if (!named()) {
    print_text(text);
    return done;
  }
  const auto written = write_file(file, text, existing());
  return written ? done : report_error(program, failed, written.error().message);
}

}  // namespace tribotwin::twin
