#pragma once

#include <string>

#include <fmt/format.h>

#include <tribotwin/twin/io/input.hpp>

namespace tribotwin::twin {

/// The key `text` of a marker. Throws InputError through its Mapping.
inline std::string read_marker(Mapping& in) {
  constexpr std::size_t longest = 200;
  std::string text = in.text("text");
  if (text.size() > longest)
    in.fail("text", fmt::format("is {} bytes long, but at most {} are kept", text.size(), longest));
  return text;
}

}  // namespace tribotwin::twin
