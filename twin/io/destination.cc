#include <tribotwin/twin/io/destination.hpp>
#include <tribotwin/twin/io/output.hpp>

namespace tribotwin::twin {

tl::expected<void, std::string> Destination::check(const std::vector<std::filesystem::path>& inputs) const {
  return named() ? check_output(file, existing(), inputs) : tl::expected<void, std::string>{};
}

int Destination::deliver(std::string_view program, std::string_view text) const {
  if (!named()) {
    print_text(text);
    return done;
  }
  const auto written = write_file(file, text, existing());
  return written ? done : complain(program, failed, written.error());
}

}  // namespace tribotwin::twin
