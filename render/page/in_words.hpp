#pragma once

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <utility>

#include <fmt/format.h>

/// Numbers and names as pages say them.
namespace tribotwin::render {

/// "4.2 %" of 0.042, "31 %" of 0.31, "less than 0.1 %" of less than that but not of 0, "99.7 %" of 0.997, "more than
/// 99.9 %" of what is nearly 1; a dash where there is no number.
inline std::string percent(double share) {
  if (std::isnan(share)) return "–";
  if (share == 0) return "0 %";
  if (share < 1e-3) return "less than 0.1 %";
  if (share > 0.999 && share < 1) return "more than 99.9 %";
  return fmt::format("{:.{}f} %", 100 * share, share < 0.1 || (share >= 0.995 && share < 1) ? 1 : 0);
}

/// "10⁻⁵" of -5.
inline std::string power_of_ten(int power) {
  static constexpr const char* digits[] = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  std::string out = power < 0 ? "10⁻" : "10";
  for (const char c : std::to_string(std::abs(power))) out += digits[c - '0'];
  return out;
}

/// A number as fmt writes it, with its power of ten typeset: "1.30e-05" is "1.30·10⁻⁵".
inline std::string typeset(std::string number) {
  const auto e = number.find('e');
  const std::string power = e == std::string::npos ? "" : "·" + power_of_ten(std::stoi(number.substr(e + 1)));
  number.resize(std::min(e, number.size()));
  if (number.ends_with('.')) number.pop_back();
  return number + power;
}

/// "kg m²" of "kg m^2"; other powers stay.
inline std::string with_superscripts(std::string text) {
  for (const auto& [power, written] : {std::pair{"^2", "²"}, std::pair{"^3", "³"}})
    for (auto at = text.find(power); at != text.npos; at = text.find(power, at + 1)) {
      const bool unit = at > 0 && std::isalpha(static_cast<unsigned char>(text[at - 1])) &&
                        (at + 2 == text.size() || !std::isalnum(static_cast<unsigned char>(text[at + 2])));
      if (unit) text.replace(at, 2, written);
    }
  return text;
}

/// "0.00" of "-0.00", what rounding makes of a small negative number; other numbers as they are.
inline std::string without_minus_of_zero(std::string number) {
  return number.starts_with('-') && number.find_first_not_of("-0.") == number.npos ? number.substr(1) : number;
}

/// "2.75900 ± 0.00067" to the second digit of sigma, a number > 0.
inline std::string with_sigma(double value, double sigma) {
  const int decimals = std::clamp(1 - static_cast<int>(std::floor(std::log10(sigma))), 0, 9);
  return fmt::format("{} ± {:.{}f}", without_minus_of_zero(fmt::format("{:.{}f}", value, decimals)), sigma, decimals);
}

/// "serial number 12" of "12"; nothing of none.
inline std::string serial_number_in_words(const std::string& number) {
  return number.empty() ? "" : "serial number " + number;
}

/// "slow" of "runs/slow/", "robot.yaml" of "laws/robot.yaml".
inline std::string without_folder(const std::filesystem::path& file) {
  return (file.has_filename() ? file : file.parent_path()).filename().string();
}

}  // namespace tribotwin::render
