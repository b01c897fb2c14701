#pragma once

#include <string>
#include <string_view>

namespace tribotwin::hil {

inline constexpr std::size_t longest_identifier = 32;

/// A name as other tools accept it (a DBC identifier, a ROS node): letters, digits and underscores, and no digit first.
inline std::string identifier(std::string_view name) {
  std::string out;
  for (const char c : name) out += (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ? c : '_';
  if (out.empty() || (out[0] >= '0' && out[0] <= '9')) out.insert(out.begin(), '_');
  return out.substr(0, longest_identifier);
}

}  // namespace tribotwin::hil
