#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <functional>
#include <map>
#include <optional>
#include <sstream>

#include <fmt/format.h>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/plugins/transmission/hysteresis.hpp>

namespace tribotwin::drive {
namespace {

struct Key {
  const char* name;
  const char* unit;
  const char* fallback;  ///< "" = required
  double minimum, maximum;
  const char* meaning;
};

constexpr double large = 1e9;
constexpr Key number_keys[] = {
    {"torque_max_nm", "Nm", "", 1e-9, large,
     "largest manipulation torque at low speed (P1), arm side: unit of load and of normalised laws"},
    {"gear_ratio", "1", "", 1e-6, 1e6, "motor turns per joint turn"},
    {"T_amb", "degC", "25", -100, 300, "ambient temperature; the temperature at reset"},
    {"brake_torque_nm", "Nm", "0", 0, large, "holding brake, arm side"},
    {"load_filter_s", "s", "0", 0, 100,
     "time constant of the load that friction sees; 0 = the load of the step before"},
    {"speed_max_rad_s", "rad/s", "of the law", 0, 1e6, "end of the law's range, on the law's side"},
    {"load_max", "-", "of the law", 0, 1e3, "end of the law's range, load / torque_max_nm"},
    {"temperature_min_degC", "degC", "of the law", -273.15, 1000, "start of the law's range"},
    {"temperature_max_degC", "degC", "of the law", -273.15, 1000, "end of the law's range"},
};
constexpr Key word_keys[] = {
    {"law", "", "", 0, 0, "friction law, one of the table below"},
    {"thermal", "", "prescribed", 0, 0, "prescribed, first_order or second_order"},
    {"friction", "", "static", 0, 0,
     "static (the law limits a constraint), lugre or gear_loss (bristles over the law; the actuator then has actdim "
     "4)"},
    {"validity", "", "clamp", 0, 0, "outside the law's range: clamp, extrapolate or error"},
};
/// Of friction="lugre": P4 (5).
constexpr Key lugre_keys[] = {
    {"sigma0", "law/rad", "", 1e-12, 1e15, "bristle stiffness: unit of the law per rad on its side"},
    {"sigma1", "law s/rad", "", 0, 1e15, "bristle damping at standstill: unit of the law per rad/s on its side"},
    {"vd", "rad/s", "", 1e-9, 1e9, "speed over which that damping fades, e^-(w/vd)^2, on the law's side"},
};
/// Of friction="gear_loss".
constexpr Key gear_loss_keys[] = {
    {"mu_avg", "1", "", 0, 1, "friction per load torque, mean of both directions"},
    {"mu_dif", "1", "", -1, 1, "half the difference, driving minus driven; |mu_dif| <= mu_avg, mu_avg + |mu_dif| < 1"},
    {"h", "rad", "", 1e-12, 1e9, "length of motion over which friction turns round, on the law's side"},
};
struct DynamicsInfo {
  const char* name;
  Dynamics dynamics;
  std::span<const Key> keys;
};
constexpr DynamicsInfo dynamics_table[] = {{"static", Dynamics::none, {}},
                                           {"lugre", Dynamics::lugre, lugre_keys},
                                           {"gear_loss", Dynamics::gear_loss, gear_loss_keys}};
/// Where the keys of a kind go.
std::array<double*, 3> dynamics_values(Drive& d) {
  if (d.dynamics == Dynamics::gear_loss) return {&d.gear_loss.mu_avg, &d.gear_loss.mu_dif, &d.gear_loss.length_rad};
  return {&d.bristles.sigma0, &d.bristles.sigma1, &d.bristles.vd};
}

/// Lists of numbers, separated by spaces.
constexpr Key list_keys[] = {
    {"load_table_speeds", "rad/s", "", 0, 1e6, "load table: speeds |w| on the law's side, ascending"},
    {"load_table_loads", "-", "", -1e3, 1e3,
     "load table: loads / torque_max_nm, ascending; above 0 the gear drives the load, below 0 the load drives"},
    {"load_table_values", "law", "", -1e9, 1e9,
     "load table: friction added to the law's weakening part, a row of loads per speed, unit of the law (P4 (4))"},
};
constexpr std::pair<const char*, friction::Validity> validities[] = {
    {"clamp", friction::Validity::clamp},
    {"extrapolate", friction::Validity::extrapolate},
    {"error", friction::Validity::error},
};

Result<double> number(std::string_view key, const std::string& text, std::string_view unit, double minimum,
                      double maximum) {
  const char* first = text.data() + (text.starts_with('+') ? 1 : 0);
  const char* last = text.data() + text.size();
  double value = 0;
  const auto [end, error] = std::from_chars(first, last, value);
  if (error != std::errc{} || end != last || !std::isfinite(value))
    return tl::unexpected(fmt::format("key '{}' is '{}' but must be a finite number [{}]", key, text, unit));
  if (value < minimum || value > maximum)
    return tl::unexpected(
        fmt::format("key '{}' is {} but must be within {} .. {} [{}]", key, value, minimum, maximum, unit));
  return value;
}

/// LuGre is passive while sigma1 e^-(w/vd)^2 |w| <= 4 g; beyond, damped bristles can drive the joint (Olsson 1996, with
/// the fading damping of P4). The left side is largest at w = vd / sqrt 2.
std::optional<std::string> bristles_that_push(const Drive& drive) {
  constexpr double largest = 0.42888194248035340;  // e^-1/2 / sqrt 2
  const auto& range = drive.law.range;
  double g = friction::unlimited;
  for (const double T : {range.temperature_min_degC, range.temperature_max_degC, drive.thermal.T_amb_degC}) {
    const auto at = friction::at_temperature(drive.law, std::isfinite(T) ? T : drive.thermal.T_amb_degC);
    for (const double w : {0.0, 0.1, 0.3, 0.7, 1.0, 1.5}) {
      const auto level = drive::level(drive, at, w * drive.bristles.vd, 0);
      g = std::min(g, level.weakening + std::min(level.strengthening, 0.0));
    }
  }
  const double most = 4 * g / (largest * drive.bristles.vd);
  if (drive.bristles.sigma1 <= most) return std::nullopt;
  return fmt::format(
      "friction 'lugre': sigma1 {} with vd {} would let the bristles drive the joint; at this vd sigma1 must not be "
      "above {:.3g}, "
      "or shorten vd",
      drive.bristles.sigma1, drive.bristles.vd, most);
}

}  // namespace

std::span<const char* const> all_keys() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    const auto add = [&all](std::string_view name) {
      if (std::ranges::find(all, name) == all.end()) all.emplace_back(name);
    };
    for (const Key& key : word_keys) add(key.name);
    for (const Key& key : number_keys) add(key.name);
    for (const Key& key : list_keys) add(key.name);
    for (const DynamicsInfo& info : dynamics_table)
      for (const Key& key : info.keys) add(key.name);
    for (const auto& law : friction::laws())
      for (const auto& p : law.parameters) add(p.name);
    for (const thermal::Order order : thermal::orders())
      for (const auto& p : thermal::parameters(order)) add(p.name);
    return all;
  }();
  static const std::vector<const char*> pointers = [] {
    std::vector<const char*> all;
    for (const std::string& name : names) all.push_back(name.c_str());
    return all;
  }();
  return pointers;
}

Result<Drive> make_drive(std::string name, const Configuration& configuration) {
  std::map<std::string, std::string, std::less<>> left;
  for (const auto& [key, value] : configuration)
    if (!value.empty() && !left.emplace(key, value).second)
      return tl::unexpected(fmt::format("key '{}' is given twice", key));
  const auto take = [&left](std::string_view key) -> std::optional<std::string> {
    const auto found = left.find(key);
    if (found == left.end()) return std::nullopt;
    std::string value = std::move(found->second);
    left.erase(found);
    return value;
  };
  const auto take_number = [&](const auto& key, bool required) -> Result<std::optional<double>> {
    const auto text = take(key.name);
    if (!text) {
      if (required) return tl::unexpected(fmt::format("key '{}' is missing: {} [{}]", key.name, key.meaning, key.unit));
      return std::nullopt;
    }
    const auto value = number(key.name, *text, key.unit, key.minimum, key.maximum);
    if (!value) return tl::unexpected(value.error());
    return *value;
  };

  Drive drive{.name = std::move(name)};

  const auto law_name = take("law");
  std::vector<std::string_view> law_names;
  for (const auto& info : friction::laws()) law_names.push_back(info.name);
  if (!law_name) return tl::unexpected(fmt::format("key 'law' is missing: one of {}", fmt::join(law_names, ", ")));
  const friction::LawInfo* info = friction::find_law(*law_name);
  if (!info) return tl::unexpected(friction::make_law(*law_name, {}).error().message);

  const auto thermal_name = take("thermal").value_or("prescribed");
  const auto orders = thermal::orders();
  const auto order = std::ranges::find(orders, thermal_name, &thermal::name);
  if (order == orders.end())
    return tl::unexpected(
        fmt::format("key 'thermal' is '{}' but must be prescribed, first_order or second_order", thermal_name));

  const auto dynamics_name = take("friction").value_or("static");
  const auto dynamics =
      std::ranges::find(dynamics_table, dynamics_name, [](const auto& d) { return std::string_view(d.name); });
  if (dynamics == std::end(dynamics_table))
    return tl::unexpected(fmt::format("key 'friction' is '{}' but must be static, lugre or gear_loss", dynamics_name));
  drive.dynamics = dynamics->dynamics;

  const auto validity_name = take("validity").value_or("clamp");
  const auto validity =
      std::ranges::find(validities, validity_name, [](const auto& v) { return std::string_view(v.first); });
  if (validity == std::end(validities))
    return tl::unexpected(fmt::format("key 'validity' is '{}' but must be clamp, extrapolate or error", validity_name));

  std::vector<std::pair<std::string, double>> law_values;
  for (const auto& p : info->parameters)
    if (auto text = take(p.name)) {
      const auto value = number(p.name, *text, p.unit, p.minimum, p.maximum);
      if (!value) return tl::unexpected(fmt::format("law '{}': {}", info->name, value.error().message));
      law_values.emplace_back(p.name, *value);
    }
  auto law = friction::make_law(*law_name, law_values);
  if (!law) return tl::unexpected(law.error());
  drive.law = *law;
  drive.law.validity = validity->second;

  std::map<std::string_view, std::optional<double>> numbers;
  for (const Key& key : number_keys) {
    const auto value = take_number(key, key.fallback[0] == '\0');
    if (!value) return tl::unexpected(value.error());
    numbers[key.name] = *value;
  }
  drive.torque_max_nm = *numbers["torque_max_nm"];
  drive.gear_ratio = *numbers["gear_ratio"];
  drive.brake_torque_nm = numbers["brake_torque_nm"].value_or(0);
  drive.load_filter_s = numbers["load_filter_s"].value_or(0);
  friction::Range& range = drive.law.range;
  range.speed_max_rad_s = numbers["speed_max_rad_s"].value_or(range.speed_max_rad_s);
  range.load_max = numbers["load_max"].value_or(range.load_max);
  range.temperature_min_degC = numbers["temperature_min_degC"].value_or(range.temperature_min_degC);
  range.temperature_max_degC = numbers["temperature_max_degC"].value_or(range.temperature_max_degC);
  if (range.temperature_min_degC > range.temperature_max_degC)
    return tl::unexpected(fmt::format("temperature_min_degC {} lies above temperature_max_degC {}",
                                      range.temperature_min_degC, range.temperature_max_degC));

  const auto dynamics_target = dynamics_values(drive);
  for (std::size_t i = 0; i < dynamics->keys.size(); ++i) {
    const auto value = take_number(dynamics->keys[i], true);
    if (!value) return tl::unexpected(fmt::format("friction '{}': {}", dynamics_name, value.error().message));
    *dynamics_target[i] = **value;
  }

  std::vector<double>* const lists[] = {&drive.load_table.speeds_rad_s, &drive.load_table.loads,
                                        &drive.load_table.values};
  std::size_t lists_given = 0;
  for (std::size_t i = 0; i < std::size(list_keys); ++i) {
    const Key& key = list_keys[i];
    const auto text = take(key.name);
    if (!text) continue;
    ++lists_given;
    std::istringstream words(*text);
    for (std::string word; words >> word;) {
      const auto value = number(key.name, word, key.unit, key.minimum, key.maximum);
      if (!value) return tl::unexpected(value.error());
      lists[i]->push_back(*value);
    }
    if (i < 2 &&
        (lists[i]->empty() || std::ranges::adjacent_find(*lists[i], std::greater_equal<>()) != lists[i]->end()))
      return tl::unexpected(
          fmt::format("key '{}' is '{}' but must be ascending numbers [{}]", key.name, *text, key.unit));
  }
  const LoadTable& load_table = drive.load_table;
  if (lists_given != 0 && lists_given != std::size(list_keys))
    return tl::unexpected(std::string("a load table needs load_table_speeds, load_table_loads and load_table_values"));
  if (load_table.values.size() != load_table.speeds_rad_s.size() * load_table.loads.size())
    return tl::unexpected(
        fmt::format("key 'load_table_values' has {} numbers but must have {}: a row of {} loads for each of {} speeds",
                    load_table.values.size(), load_table.speeds_rad_s.size() * load_table.loads.size(),
                    load_table.loads.size(), load_table.speeds_rad_s.size()));

  std::vector<double> thermal_values;
  for (const auto& p : thermal::parameters(*order)) {
    const auto value = take_number(p, true);
    if (!value) return tl::unexpected(fmt::format("thermal '{}': {}", thermal_name, value.error().message));
    thermal_values.push_back(**value);
  }
  drive.thermal = thermal::make_model(*order, numbers["T_amb"].value_or(25), thermal_values);
  if (drive.dynamics == Dynamics::lugre)
    if (const auto wrong = bristles_that_push(drive)) return tl::unexpected(*wrong);
  if (const auto wrong = drive.dynamics == Dynamics::gear_loss ? &drive.gear_loss : nullptr)
    if (std::abs(wrong->mu_dif) > wrong->mu_avg || wrong->mu_avg + std::abs(wrong->mu_dif) >= 1)
      return tl::unexpected(fmt::format(
          "friction 'gear_loss': mu_avg {}, mu_dif {} must keep |mu_dif| <= mu_avg (friction opposes motion) "
          "and mu_avg + |mu_dif| < 1 (the gear does not lock itself)",
          wrong->mu_avg, wrong->mu_dif));

  if (!left.empty()) {
    std::vector<std::string_view> accepted;
    for (const Key& key : word_keys) accepted.push_back(key.name);
    for (const Key& key : number_keys) accepted.push_back(key.name);
    for (const auto& p : info->parameters) accepted.push_back(p.name);
    for (const auto& p : thermal::parameters(*order)) accepted.push_back(p.name);
    for (const Key& key : dynamics->keys) accepted.push_back(key.name);
    for (const Key& key : list_keys) accepted.push_back(key.name);
    return tl::unexpected(fmt::format(
        "key '{}' is not known for law '{}', thermal '{}' and friction '{}'; did you mean '{}'?", left.begin()->first,
        info->name, thermal_name, dynamics_name, friction::nearest(left.begin()->first, accepted)));
  }

  // Friction follows the load of the step before; the loop friction -> load -> friction must contract.
  double table_slope = 0;  // law per load
  for (std::size_t i = 1; i < load_table.values.size(); ++i)
    if (const std::size_t column = i % load_table.loads.size(); column > 0)
      table_slope = std::max(table_slope, std::abs(load_table.values[i] - load_table.values[i - 1]) /
                                              (load_table.loads[column] - load_table.loads[column - 1]));
  if (info->load_dependent || table_slope > 0) {
    const double per_load_nm = drive.torque_scale_nm() * (friction::growth_with_load(drive.law) + table_slope);
    const double gain = per_load_nm / drive.torque_max_nm;
    if (gain >= 1)
      return tl::unexpected(
          fmt::format("law '{}': friction grows by {} Nm per Nm of load at standstill; at 1 or more the gear would "
                      "lock itself for ever",
                      info->name, gain));
  }
  return drive;
}

Configuration configuration_of(const Drive& drive) {
  Configuration c{{"law", std::string(drive.law.info->name)}};
  const auto add = [&c](std::string_view key, double value) { c.emplace_back(key, fmt::format("{}", value)); };
  const auto& info = *drive.law.info;
  for (std::size_t i = 0; i < info.parameters.size(); ++i) add(info.parameters[i].name, drive.law.parameters[i]);
  add("torque_max_nm", drive.torque_max_nm);
  add("gear_ratio", drive.gear_ratio);
  c.emplace_back("validity",
                 std::ranges::find(validities, drive.law.validity, [](const auto& v) { return v.second; })->first);
  if (drive.dynamics != Dynamics::none) {
    const DynamicsInfo& how = *std::ranges::find(dynamics_table, drive.dynamics, &DynamicsInfo::dynamics);
    Drive copy = drive;
    const auto values = dynamics_values(copy);
    c.emplace_back("friction", how.name);
    for (std::size_t i = 0; i < how.keys.size(); ++i) add(how.keys[i].name, *values[i]);
  }
  if (!drive.load_table.values.empty()) {
    c.emplace_back("load_table_speeds", fmt::format("{}", fmt::join(drive.load_table.speeds_rad_s, " ")));
    c.emplace_back("load_table_loads", fmt::format("{}", fmt::join(drive.load_table.loads, " ")));
    c.emplace_back("load_table_values", fmt::format("{}", fmt::join(drive.load_table.values, " ")));
  }
  const auto& range = drive.law.range;
  if (std::isfinite(range.speed_max_rad_s)) add("speed_max_rad_s", range.speed_max_rad_s);
  if (std::isfinite(range.load_max)) add("load_max", range.load_max);
  if (std::isfinite(range.temperature_min_degC)) add("temperature_min_degC", range.temperature_min_degC);
  if (std::isfinite(range.temperature_max_degC)) add("temperature_max_degC", range.temperature_max_degC);
  c.emplace_back("thermal", thermal::name(drive.thermal.order));
  add("T_amb", drive.thermal.T_amb_degC);
  if (drive.thermal.order == thermal::Order::first) {
    add("R_th", drive.thermal.resistance_K_W());
    add("kappa", drive.thermal.t_s[0]);
  } else if (drive.thermal.order == thermal::Order::second) {
    for (int i = 0; i < 2; ++i) {
      add(i ? "c2" : "c1", drive.thermal.gain_K_J[i]);
      add(i ? "t2" : "t1", drive.thermal.t_s[i]);
    }
  }
  add("brake_torque_nm", drive.brake_torque_nm);
  add("load_filter_s", drive.load_filter_s);
  return c;
}

std::string reference_markdown() {
  const auto bound = [](double x) { return std::isinf(x) ? std::string("any") : fmt::format("{:g}", x); };
  std::string out = "### Keys of every drive\n\n| key | unit | default | range | meaning |\n|---|---|---|---|---|\n";
  for (const Key& key : word_keys)
    out += fmt::format("| `{}` | | {} | | {} |\n", key.name, key.fallback[0] ? key.fallback : "required", key.meaning);
  for (const Key& key : number_keys)
    out += fmt::format("| `{}` | {} | {} | {:g} .. {:g} | {} |\n", key.name, key.unit,
                       key.fallback[0] ? key.fallback : "required", key.minimum, key.maximum, key.meaning);
  for (const Key& key : list_keys)
    out += fmt::format("| `{}` | {} | no table | {:g} .. {:g} | {} |\n", key.name, key.unit, key.minimum, key.maximum,
                       key.meaning);
  out +=
      "\n### Dynamic friction\n\nOver any law, with g its weakening and h its strengthening part, w the speed on its "
      "side.\n\n"
      "- `lugre` (P4 (5)): `z' = w - sigma0 |w| z / g`, `tau_f = sigma0 z + sigma1 e^-(w/vd)^2 z' + h`\n"
      "- `gear_loss` (google-deepmind/mujoco issue 3528): `z' = (w - |w| z) / h`, `tau_f = (g + mu_avg |tau|) z + "
      "mu_dif tau z^2 +` the h of the law\n\n"
      "| `friction` | key | unit | range | meaning |\n|---|---|---|---|---|\n";
  for (const DynamicsInfo& info : dynamics_table)
    for (const Key& key : info.keys)
      out += fmt::format("| `{}` | `{}` | {} | {:g} .. {:g} | {} |\n", info.name, key.name, key.unit, key.minimum,
                         key.maximum, key.meaning);
  out +=
      "\n### Thermal models\n\n| `thermal` | key | unit | range | meaning | source |\n|---|---|---|---|---|---|\n"
      "| `prescribed` | | | | the temperature is set from outside, T_amb until then | |\n";
  for (const thermal::Order order : thermal::orders())
    for (const auto& p : thermal::parameters(order))
      out += fmt::format("| `{}` | `{}` | {} | {:g} .. {:g} | {} | {} |\n", thermal::name(order), p.name, p.unit,
                         p.minimum, p.maximum, p.meaning, p.source);
  out += "\n### Friction laws\n";
  for (const auto& law : friction::laws()) {
    out += fmt::format(
        "\n#### `{}`\n\n`{}` ({})\n\nSpeed v on the {} side [rad/s], torque {}. Identified for speeds up to "
        "{} rad/s",
        law.name, law.equation, law.source, law.side == friction::Side::motor ? "motor" : "arm",
        law.normalised ? "over torque_max_nm, load l = |tau_m| / torque_max_nm" : "in Nm, arm side",
        bound(law.identified.speed_max_rad_s));
    if (law.load_dependent) out += fmt::format(", loads up to {}", bound(law.identified.load_max));
    if (law.temperature_dependent && std::isfinite(law.identified.temperature_min_degC))
      out += fmt::format(", {} .. {} degC", bound(law.identified.temperature_min_degC),
                         bound(law.identified.temperature_max_degC));
    out += ".\n\n| key | unit | range | published | meaning |\n|---|---|---|---|---|\n";
    for (const auto& p : law.parameters) {
      std::string published = std::isnan(p.published) ? "" : fmt::format("{:g}", p.published);
      if (!std::isnan(p.sigma)) published += fmt::format(" +- {:g}", p.sigma);
      out += fmt::format("| `{}` | {} | {:g} .. {:g} | {} | {} |\n", p.name, p.unit, p.minimum, p.maximum, published,
                         p.meaning);
    }
  }
  out += transmission::reference_markdown();
  return out;
}

}  // namespace tribotwin::drive
