#include <array>
#include <cerrno>
#include <cstring>
#include <istream>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/reading.hpp>

namespace tribotwin {

std::optional<std::string> rest_of(std::istream& stream) {
  std::string text;
  std::array<char, 1 << 16> part;
  while (stream) {
    stream.read(part.data(), part.size());
    text.append(part.data(), static_cast<std::size_t>(stream.gcount()));
  }
  return stream.bad() ? std::nullopt : std::optional(std::move(text));
}

tl::unexpected<Error> not_read(std::string_view file) {
  return work_failed(fmt::format("{}: cannot be read to its end ({})", file, std::strerror(errno)));
}

}  // namespace tribotwin
