#pragma once

// Stands in for libfmt where the plugin is built alone: as much of it as the messages of a drive need, with the same
// output. The full build compiles the same sources with libfmt, which checks every pattern at compile time.
#include <charconv>
#include <concepts>
#include <cstdio>
#include <string>
#include <string_view>

namespace fmt {

/// A value of a message. `spec` is what stands behind the colon of its braces: "", "g" or ".Ng".
inline std::string text(double x, std::string_view spec) {
  char out[400];
  if (!spec.empty()) {
    const std::string pattern = "%" + std::string(spec);
    return std::string(out, std::snprintf(out, sizeof out, pattern.c_str(), x));
  }
  const auto shortest = [&](std::chars_format how) {
    return std::string(out, std::to_chars(out, out + sizeof out, x, how).ptr);
  };
  const std::string scientific = shortest(std::chars_format::scientific);
  const auto e = scientific.find('e');
  if (e == std::string::npos) return scientific;  // inf, nan
  const int exponent = std::stoi(scientific.substr(e + 1));
  return exponent >= -4 && exponent < 16 ? shortest(std::chars_format::fixed) : scientific;
}
inline std::string text(std::integral auto x, std::string_view) { return std::to_string(x); }
inline std::string text(std::string_view x, std::string_view) { return std::string(x); }

/// `pattern` with its {} and {:SPEC} replaced by the values in their order.
template <class... Values>
std::string format(std::string_view pattern, const Values&... values) {
  std::string out;
  const auto put = [&](const auto& value) {
    const auto open = pattern.find('{'), close = pattern.find('}', open);
    if (close == std::string_view::npos) return;
    const std::string_view inside = pattern.substr(open + 1, close - open - 1);
    out += std::string(pattern.substr(0, open)) + text(value, inside.empty() ? inside : inside.substr(1));
    pattern.remove_prefix(close + 1);
  };
  (put(values), ...);
  return out + std::string(pattern);
}

template <class Range>
std::string join(const Range& values, std::string_view separator) {
  std::string out;
  for (const auto& value : values) out += (out.empty() ? std::string() : std::string(separator)) + text(value, {});
  return out;
}

}  // namespace fmt
