#include <algorithm>

#include <fmt/format.h>

#include <tribotwin/twin/io/name.hpp>

namespace tribotwin::twin {
namespace {

/// File systems allow 255; the rest is for endings such as ".telemetry.h5.partial".
constexpr std::size_t max_bytes = 200;

bool is_control(char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; }

/// The name on one line, shortened.
std::string shown(std::string_view name) {
  std::string out;
  for (const char c : name.substr(0, 60))
    out += is_control(c) ? fmt::format("\\x{:02x}", static_cast<unsigned char>(c)) : std::string(1, c);
  return name.size() > 60 ? out + "..." : out;
}

}  // namespace

std::optional<std::string> unfit_file_name(std::string_view name) {
  std::string wrong;
  if (name.empty())
    wrong = "is empty";
  else if (name == "." || name == "..")
    wrong = "is a folder of the file system";
  else if (name.find('/') != name.npos)
    wrong = "contains '/'";
  else if (std::ranges::any_of(name, is_control))
    wrong = "contains a control character";
  else if (name.size() > max_bytes)
    wrong = fmt::format("has {} bytes", name.size());
  else
    return std::nullopt;
  return fmt::format(
      "'{}' {} but must be a file name: 1 to {} bytes without '/' and control characters, not '.' or '..'", shown(name),
      wrong, max_bytes);
}

}  // namespace tribotwin::twin
