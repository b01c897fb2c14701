#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/twin/identification/quantity_keys.hpp>

namespace tribotwin::twin::identification {
namespace {

constexpr Key plain[] = {
    {Place::joint, "armature", 0, 1e9},
    {Place::joint, "damping", 0, 1e9},
    {Place::joint, "ref", -1e3, 1e3},
    {Place::body, "mass_kg", 1e-9, 1e9},
    {Place::control, "position_gain_1_s", 0, 1e6, nullptr, &LoopGains::position_gain_1_s, Controller::servo},
    {Place::control, "speed_gain_nm_s_rad", 1e-9, 1e9, nullptr, &LoopGains::speed_gain_nm_s_rad, Controller::velocity},
    {Place::control, "integral_time_s", 0, 1e6, nullptr, &LoopGains::integral_time_s, Controller::velocity},
    {Place::control, "torque_gain", 0, 1e6, nullptr, &LoopGains::torque_gain, Controller::torque},
    {Place::control, "torque_limit_nm", 0, 1e9, nullptr, &LoopGains::torque_limit_nm, Controller::torque},
    {Place::motion, "delay_s", 0, 10},
};

/// Those of the loops and those of a small servo; a name of both is one key.
const std::vector<Key>& keys() {
  static const std::vector<Key> all = [] {
    std::vector<Key> made(std::begin(plain), std::end(plain));
    for (const DcPositionKey& key : dc_position_keys()) {
      const auto known =
          std::ranges::find_if(made, [&](const Key& k) { return k.place == Place::control && k.name == key.name; });
      if (known != made.end())
        known->dc = &key;
      else
        made.push_back({Place::control, key.name, key.minimum, std::min(key.maximum, 1e9), &key});
    }
    return made;
  }();
  return all;
}

/// Keys of a drive whose values are no numbers.
constexpr std::string_view not_numbers[] = {"law", "thermal", "validity"};

}  // namespace

const Key* find_key(Place place, std::string_view name) {
  const auto& all = keys();
  const auto found = std::ranges::find_if(all, [&](const Key& k) { return k.place == place && k.name == name; });
  return found == all.end() ? nullptr : &*found;
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

std::string_view name(Controller controller) {
  static constexpr std::string_view names[] = {"dc_position", "servo", "velocity", "torque"};
  return names[static_cast<std::size_t>(controller)];
}

bool has_key(Controller controller, std::string_view key) {
  const Key* known = find_key(Place::control, key);
  if (!known) return false;
  return controller == Controller::dc_position ? known->dc != nullptr
                                               : known->servo != nullptr && controller <= known->innermost;
}

std::vector<std::string_view> keys_of(Place place, const friction::LawInfo& law) {
  std::vector<std::string_view> all;
  if (place == Place::drive) {
    for (const auto& p : law.parameters) all.push_back(p.name);
    for (const char* key : drive::all_keys())
      if (!is_law_parameter(key) && std::ranges::find(not_numbers, key) == std::end(not_numbers)) all.emplace_back(key);
  }
  for (const Key& key : keys())
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
