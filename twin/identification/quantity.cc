#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/twin/identification/quantity_keys.hpp>

namespace tribotwin::twin::identification {
namespace {

constexpr Key keys[] = {
    {Place::joint, "armature", 0, 1e9},
    {Place::joint, "damping", 0, 1e9},
    {Place::joint, "ref", -1e3, 1e3},
    {Place::body, "mass_kg", 1e-9, 1e9},
    {Place::control, "kp", 0, 1e9, &DcPositionOptions::kp},
    {Place::control, "error_gain", 0, 1e9, &DcPositionOptions::error_gain},
    {Place::control, "supply_V", 0, 1e6, &DcPositionOptions::supply_V},
    {Place::control, "resistance_ohm", 1e-9, 1e9, &DcPositionOptions::resistance_ohm},
    {Place::control, "supply_resistance_ohm", 0, 1e9, &DcPositionOptions::supply_resistance_ohm},
    {Place::control, "kt_nm_A", 0, 1e6, &DcPositionOptions::kt_nm_A},
    {Place::control, "torque_limit_nm", 0, 1e9, &DcPositionOptions::torque_limit_nm, &LoopGains::torque_limit_nm},
    {Place::control, "duty_limit", 0, 1, &DcPositionOptions::duty_limit},
    {Place::control, "duty_slew_1_s", 1e-3, 1e9, &DcPositionOptions::duty_slew_1_s},
    {Place::control, "resistance_per_K", -0.1, 0.1, &DcPositionOptions::resistance_per_K},
    {Place::control, "reference_degC", -100, 300, &DcPositionOptions::reference_degC},
    {Place::control, "position_gain_1_s", 0, 1e6, nullptr, &LoopGains::position_gain_1_s},
    {Place::control, "speed_gain_nm_s_rad", 1e-9, 1e9, nullptr, &LoopGains::speed_gain_nm_s_rad},
    {Place::control, "integral_time_s", 0, 1e6, nullptr, &LoopGains::integral_time_s},
    {Place::motion, "delay_s", 0, 10},
};

/// Keys of a drive whose values are no numbers.
constexpr std::string_view not_numbers[] = {"law", "thermal", "validity"};

}  // namespace

const Key* find_key(Place place, std::string_view name) {
  const auto found = std::ranges::find_if(keys, [&](const Key& k) { return k.place == place && k.name == name; });
  return found == std::end(keys) ? nullptr : found;
}

bool is_law_parameter(std::string_view key) {
  return std::ranges::any_of(friction::laws(), [&](const auto& law) {
    return std::ranges::find(law.parameters, key, &friction::Parameter::name) != law.parameters.end();
  });
}

std::string_view name(Place place) {
  static constexpr std::string_view names[] = {"drive", "joint", "body", "control", "motion"};
  return names[static_cast<std::size_t>(place)];
}

std::string_view name(Controller controller) { return controller == Controller::servo ? "servo" : "dc_position"; }

bool has_key(Controller controller, std::string_view key) {
  const Key* known = find_key(Place::control, key);
  return known && (controller == Controller::servo ? known->servo != nullptr : known->dc != nullptr);
}

std::vector<std::string_view> keys_of(Place place, const friction::LawInfo& law) {
  std::vector<std::string_view> all;
  if (place == Place::drive) {
    for (const auto& p : law.parameters) all.push_back(p.name);
    for (const char* key : drive::all_keys())
      if (!is_law_parameter(key) && std::ranges::find(not_numbers, key) == std::end(not_numbers)) all.emplace_back(key);
  }
  for (const Key& key : keys)
    if (key.place == place) all.push_back(key.name);
  return all;
}

std::pair<double, double> accepted_range(Place place, const friction::LawInfo& law, std::string_view key) {
  if (const Key* known = find_key(place, key)) return {known->minimum, known->maximum};
  const auto p = std::ranges::find(law.parameters, key, &friction::Parameter::name);
  return p != law.parameters.end() ? std::pair{p->minimum, p->maximum} : std::pair{-1e300, 1e300};
}

std::string Quantity::path() const {
  return owner.empty() ? fmt::format("{}.{}", name(place), key) : fmt::format("{}.{}.{}", name(place), owner, key);
}

double Quantity::scale() const {
  if (sigma > 0) return sigma;
  return (logarithmic ? std::log(high / low) : high - low) / 6;  // the bounds are at three sigma
}

double Quantity::value(double z) const {
  if (!free) return start;
  return std::clamp(logarithmic ? start * std::exp(scale() * z) : start + scale() * z, low, high);
}

double Quantity::coordinate(double value) const {
  return (logarithmic ? std::log(value / start) : value - start) / scale();
}

}  // namespace tribotwin::twin::identification
