#pragma once

#include <charconv>
#include <concepts>
#include <optional>
#include <string_view>
#include <system_error>

namespace tribotwin {

/// Parses the whole of `text` as a number: decimal point, no sign '+', no spaces, independent of the locale. Nothing
/// where the text is no such number. "nan" and "inf" are numbers here; callers decide.
inline std::optional<double> to_number(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

/// Parses the whole of `text` as an integer in digits of `base`. Nothing where the type cannot hold it.
template <std::integral Integer>
std::optional<Integer> to_integer(std::string_view text, int base = 10) {
  Integer value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

}  // namespace tribotwin
