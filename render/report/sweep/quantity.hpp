#pragma once

#include <span>
#include <string>
#include <string_view>

#include <nlohmann/json.hpp>

#include <tribotwin/render/figure/figure.hpp>

/// Numbers of a sweep as a reader wants them: with units, and as many digits as they have.
namespace tribotwin::render {

/// "°C" of "joints.joint2.temperature_degC.end", "s" of "time_above(...)"; empty where the name has no unit.
std::string unit_in(std::string_view expression);
/// "maximum temperature of joint2" of "max(joint2.temperature_degC)"; the expression where there are no words for it.
std::string in_words(const std::string& expression);
/// Of a key of the scenario; of a law's parameter where all laws that have it agree.
std::string unit_of_key(std::string_view key);

/// An output and how its numbers are written: in kJ where they are thousands of J.
struct Quantity {
  std::string name, unit;
  double factor = 1;  ///< shown = factor x value

  Quantity(std::string name, std::string unit, std::span<const double> values);
  Axis axis() const { return {.quantity = name, .unit = unit}; }
  /// With the digits that `uncertainty` (in the unit of the values) leaves, or four; without the unit.
  std::string number(double value, double uncertainty = 0) const;
  /// "58.31 °C"
  std::string with_unit(double value, double uncertainty = 0) const;
  /// The same of a difference or a deviation: "2.1 K".
  std::string difference(double value, double uncertainty = 0) const;
  /// "58.3 °C (95 %: 56.1 … 60.5)"; without interval the number alone. `estimate` as in statistics.json.
  std::string estimated(const nlohmann::json& estimate, bool is_difference = false) const;
};

/// A number or, where it is none, NaN.
double number_in(const nlohmann::json& value);
/// 95 % interval of an estimate of statistics.json; NaN where there is none.
struct Limits {
  double low, high;
  bool there() const { return low == low && high == high; }
};
Limits limits_in(const nlohmann::json& estimate);

/// "0.93, 95 %: 0.80 … 0.98"
std::string share_text(const nlohmann::json& estimate);

}  // namespace tribotwin::render
