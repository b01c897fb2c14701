#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <regex>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/render/page/in_words.hpp>
#include <tribotwin/render/report/sweep/quantity.hpp>

namespace tribotwin::render {
namespace {

constexpr std::size_t longest_expression = 1000;  ///< put in words: std::regex takes stack for each character
constexpr double no_number = std::numeric_limits<double>::quiet_NaN();

/// Endings of names, longer ones first.
constexpr std::pair<std::string_view, std::string_view> endings[] = {
    {"_rad_s2", "rad/s²"}, {"_rad_s", "rad/s"}, {"_m_s", "m/s"}, {"_degC", "°C"}, {"_norm", "-"},
    {"_share", "-"},       {"_nm", "Nm"},       {"_rad", "rad"}, {"_deg", "°"},   {"_kg", "kg"},
    {"_Hz", "Hz"},         {"_J", "J"},         {"_W", "W"},     {"_K", "K"},     {"_N", "N"},
    {"_V", "V"},           {"_A", "A"},         {"_s", "s"},     {"_m", "m"}};

std::string_view unit_at_end(std::string_view word) {
  for (const auto& [ending, unit] : endings)
    if (word.ends_with(ending)) return unit;
  return {};
}

int decimals_of(double value, double uncertainty) {
  if (uncertainty > 0) return std::clamp(1 - static_cast<int>(std::floor(std::log10(uncertainty))), 0, 9);
  if (value == 0) return 0;
  return std::clamp(3 - static_cast<int>(std::floor(std::log10(std::abs(value)))), 0, 9);
}

}  // namespace

std::string unit_in(std::string_view expression) {
  if (expression.starts_with("time_above(") || expression.starts_with("time_below(")) return "s";
  if (const auto open = expression.find('('); open != expression.npos) expression.remove_prefix(open + 1);
  expression = expression.substr(0, expression.find_first_of(",)"));
  while (true) {
    const auto dot = expression.rfind('.');
    const auto word = dot == expression.npos ? expression : expression.substr(dot + 1);
    if (const auto unit = unit_at_end(word); !unit.empty()) return std::string(unit);
    if (dot == expression.npos) return {};
    expression = expression.substr(0, dot);
  }
}

namespace {
/// "temperature" of "temperature_degC"; empty where there is no word.
std::string quantity_in_words(const std::string& name) {
  static const std::map<std::string, std::string> words{{"heat_J", "friction heat"},
                                                        {"friction_work_J", "friction work"},
                                                        {"motor_work_J", "motor work"},
                                                        {"temperature_degC", "temperature"},
                                                        {"cycle_temperature_degC", "temperature"},
                                                        {"friction_nm", "friction"},
                                                        {"load_norm", "load"},
                                                        {"velocity_rad_s", "speed"},
                                                        {"motor_torque_nm", "motor torque"},
                                                        {"cycle_friction_power_W", "friction power"}};
  const auto found = words.find(name);
  return found == words.end() ? "" : found->second;
}

/// "maximum" of "max"; empty for what is no figure of all samples.
std::string figure_in_words(const std::string& name) {
  static const std::map<std::string, std::string> words{
      {"max", "maximum"}, {"min", "minimum"}, {"max_abs", "largest"}, {"mean", "mean"}, {"rms", "RMS"}};
  const auto found = words.find(name);
  return found == words.end() ? "" : found->second;
}
}  // namespace

std::string in_words(const std::string& expression) {
  if (auto whole = quantity_in_words(expression); !whole.empty()) return whole;
  if (expression.size() > longest_expression) return expression;
  static const std::regex of_summary(R"(joints\.([^.]+)\.(\w+)(?:\.(start|end|max|rms))?)"),
      of_record(R"((max|min|max_abs|mean|rms|time_above|time_below)\(([^.]+)\.(\w+)(?:, *([^)]+))?\))");
  std::smatch part;
  const bool summary = std::regex_match(expression, part, of_summary);
  if (!summary && !std::regex_match(expression, part, of_record)) return expression;
  const std::string joint = part[summary ? 1 : 2], name = part[summary ? 2 : 3], figure = part[summary ? 3 : 1],
                    quantity = quantity_in_words(name), word = figure_in_words(figure);
  if (quantity.empty()) return expression;
  if (!word.empty()) return fmt::format("{} {} of {}", word, quantity, joint);
  if (summary)
    return fmt::format("{} of {}{}", quantity, joint,
                       figure == "end"     ? " at the end"
                       : figure == "start" ? " at the beginning"
                                           : "");
  const std::string unit = unit_in(name);
  return fmt::format("time with {} of {} {} {}{}", quantity, joint, figure == "time_above" ? "above" : "below",
                     part[4].str(), unit.empty() || unit == "-" ? "" : " " + unit);
}

std::string unit_of_key(std::string_view key) {
  if (auto unit = unit_in(key); !unit.empty()) return unit;
  const std::string_view name = key.substr(key.rfind('.') == key.npos ? 0 : key.rfind('.') + 1);
  std::string unit;
  for (const auto& law : friction::laws())
    for (const auto& parameter : law.parameters)
      if (parameter.name == name) {
        if (!unit.empty() && unit != parameter.unit) return {};
        unit = parameter.unit;
      }
  return unit;
}

Quantity::Quantity(std::string name_, std::string unit_, std::span<const double> values)
    : name(std::move(name_)), unit(std::move(unit_)) {
  double largest = 0;
  for (const double x : values)
    if (std::isfinite(x)) largest = std::max(largest, std::abs(x));
  if (unit != "J" && unit != "W" && unit != "N" && unit != "Nm") return;
  if (largest >= 1e6)
    factor = 1e-6, unit = "M" + unit;
  else if (largest >= 1e4)
    factor = 1e-3, unit = "k" + unit;
}

std::string Quantity::number(double value, double uncertainty) const {
  if (!std::isfinite(value)) return "–";
  const double shown = factor * value, sure = std::abs(factor * uncertainty);
  if (shown != 0 && (std::abs(shown) < 1e-5 || std::abs(shown) >= 1e9)) return fmt::format("{:.4g}", shown);
  return without_minus_of_zero(fmt::format("{:.{}f}", shown, decimals_of(shown, std::isfinite(sure) ? sure : 0)));
}

std::string Quantity::with_unit(double value, double uncertainty) const {
  return number(value, uncertainty) + (unit.empty() || unit == "-" ? "" : " " + unit);
}

std::string Quantity::difference(double value, double uncertainty) const {
  return unit == "°C" ? number(value, uncertainty) + " K" : with_unit(value, uncertainty);
}

std::string Quantity::estimated(const nlohmann::json& estimate, bool is_difference) const {
  const double value = number_in(estimate["value"]);
  const Limits limits = limits_in(estimate);
  const double half = limits.there() ? (limits.high - limits.low) / 2 : 0;
  const std::string text = is_difference ? difference(value, half) : with_unit(value, half);
  if (!limits.there()) return text;
  return fmt::format("{} (95 %: {} … {})", text, number(limits.low, half), number(limits.high, half));
}

double number_in(const nlohmann::json& value) { return value.is_number() ? value.get<double>() : no_number; }

Limits limits_in(const nlohmann::json& estimate) {
  if (!estimate.is_object() || !estimate.contains("confidence_95")) return {no_number, no_number};
  const auto& interval = estimate["confidence_95"];
  if (!interval.is_array() || interval.size() != 2) return {no_number, no_number};
  return {number_in(interval[0]), number_in(interval[1])};
}

std::string share_text(const nlohmann::json& estimate) {
  const Limits limits = limits_in(estimate);
  std::string text = fmt::format("{:.2f}", number_in(estimate["value"]));
  if (limits.there()) text += fmt::format(", 95 %: {:.2f} … {:.2f}", limits.low, limits.high);
  return text;
}

}  // namespace tribotwin::render
