#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <map>
#include <optional>
#include <sstream>

#include <fmt/format.h>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/plugins/drive/keys.hpp>
#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/plugins/friction/text.hpp>

namespace tribotwin::drive {
namespace {

Result<double> number(std::string_view key, const std::string& text, std::string_view unit, double minimum,
                      double maximum) {
  const auto parsed = to_number(std::string_view(text).substr(text.starts_with('+')));
  if (!parsed || !std::isfinite(*parsed))
    return tl::unexpected(fmt::format("key '{}' is '{}' but must be a finite number [{}]", key, text, unit));
  if (*parsed < minimum || *parsed > maximum)
    return tl::unexpected(
        fmt::format("key '{}' is {} but must be within {} .. {} [{}]", key, *parsed, minimum, maximum, unit));
  return *parsed;
}

/// LuGre is passive while sigma1 e^-(w/vd)^2 |w| <= 4 g; beyond, damped bristles can drive the joint (Olsson 1996, with
/// the fading damping of the RH380-N study). The left side is largest at w = vd / sqrt 2.
std::optional<std::string> bristles_that_push(const Drive& drive) {
  constexpr double largest = 0.42888194248035340;  // e^-1/2 / sqrt 2
  const auto& range = drive.law.range;
  double g = friction::unlimited;
  for (const double T : {range.temperature_min_degC, range.temperature_max_degC, drive.thermal.T_amb_degC}) {
    const auto at = friction::at_temperature(drive.law, std::isfinite(T) ? T : drive.thermal.T_amb_degC);
    for (const double w : {0.0, 0.1, 0.3, 0.7, 1.0, 1.5}) {
      const auto level = drive::level(drive, at, std::copysign(w * drive.bristles.vd, -drive.asymmetry), 0);
      g = std::min(g, level.weakening + std::min(level.strengthening, 0.0));
    }
  }
  const double max_sigma1 = 4 * g / (largest * drive.bristles.vd);
  if (drive.bristles.sigma1 <= max_sigma1) return std::nullopt;
  return fmt::format(
      "friction 'lugre': sigma1 {} with vd {} would let the bristles drive the joint; at this vd sigma1 must not be "
      "above {:.3g}, "
      "or shorten vd",
      drive.bristles.sigma1, drive.bristles.vd, max_sigma1);
}

/// Why friction would lock the drive by itself, or nothing. Friction follows the load of the step before, so the loop
/// friction -> load -> friction must contract.
std::optional<std::string> self_locking(const Drive& drive) {
  const LoadTable& table = drive.load_table;
  double table_slope = 0;  // law per load
  for (std::size_t i = 1; i < table.values.size(); ++i)
    if (const std::size_t column = i % table.loads.size(); column > 0)
      table_slope = std::max(table_slope, std::abs(table.values[i] - table.values[i - 1]) /
                                              (table.loads[column] - table.loads[column - 1]));
  if (!drive.law.info->load_dependent && table_slope == 0) return std::nullopt;
  const double per_load_nm = drive.torque_scale_nm() * (friction::growth_with_load(drive.law) + table_slope);
  const double gain = per_load_nm / drive.torque_max_nm * (1 + std::abs(drive.asymmetry));
  if (gain < 1) return std::nullopt;
  return fmt::format(
      "law '{}': friction grows by {} Nm per Nm of load at standstill; at 1 or more the gear would lock itself for "
      "ever",
      drive.law.info->name, gain);
}

/// Reads one configuration. Each stage removes the keys that it reads.
class Reader {
 public:
  explicit Reader(std::string name) : drive_{.name = std::move(name)} {}
  Result<Drive> read(const Configuration& configuration);

 private:
  std::optional<std::string> take(std::string_view key);
  /// The number of a Key or parameter; nothing where it is missing and not required.
  template <class K>
  Result<std::optional<double>> take_number(const K& key, bool required);

  Result<void> choose_kinds();
  Result<void> read_law();
  Result<void> read_numbers();
  Result<void> read_dynamics();
  Result<void> read_load_table();
  Result<void> read_thermal();
  Result<void> read_winding();
  Result<void> check_dynamics() const;
  Result<void> check_all_known() const;

  Drive drive_;
  std::map<std::string, std::string, std::less<>> left_;
  const friction::LawInfo* law_ = nullptr;
  const thermal::ModelInfo* thermal_ = nullptr;
  const DynamicsInfo* dynamics_ = nullptr;
  friction::Validity validity_ = friction::Validity::clamp;
  double T_amb_degC_ = 25;
};

std::optional<std::string> Reader::take(std::string_view key) {
  const auto found = left_.find(key);
  if (found == left_.end()) return std::nullopt;
  std::string value = std::move(found->second);
  left_.erase(found);
  return value;
}

template <class K>
Result<std::optional<double>> Reader::take_number(const K& key, bool required) {
  const auto text = take(key.name);
  if (!text) {
    if (required) return tl::unexpected(fmt::format("key '{}' is missing: {} [{}]", key.name, key.meaning, key.unit));
    return std::nullopt;
  }
  const auto value = number(key.name, *text, key.unit, key.minimum, key.maximum);
  if (!value) return tl::unexpected(value.error());
  return *value;
}

/// Reads the keys whose values are words: law, thermal model, dynamics and validity policy.
Result<void> Reader::choose_kinds() {
  const auto law_name = take("law");
  std::vector<std::string_view> law_names;
  for (const auto& info : friction::laws()) law_names.push_back(info.name);
  if (!law_name) return tl::unexpected(fmt::format("key 'law' is missing: one of {}", fmt::join(law_names, ", ")));
  law_ = friction::find_law(*law_name);
  if (!law_) return tl::unexpected(friction::make_law(*law_name, {}).error());

  const auto thermal_name = take("thermal").value_or("prescribed");
  thermal_ = thermal::find_model(thermal_name);
  if (!thermal_)
    return tl::unexpected(fmt::format("key 'thermal' is '{}' but must be {}", thermal_name, thermal::model_names()));

  const auto dynamics_name = take("friction").value_or("static");
  const auto dynamics = std::ranges::find(dynamics_table(), std::string_view(dynamics_name), &DynamicsInfo::name);
  if (dynamics == dynamics_table().end())
    return tl::unexpected(fmt::format("key 'friction' is '{}' but must be static, lugre or gear_loss", dynamics_name));
  dynamics_ = &*dynamics;
  drive_.dynamics = dynamics_->dynamics;

  const auto control_name = take("control").value_or("torque");
  const auto control = std::ranges::find(controls(), std::string_view(control_name), &ControlInfo::name);
  if (control == controls().end())
    return tl::unexpected(fmt::format("key 'control' is '{}' but must be torque or position", control_name));
  drive_.control = control->control;

  const auto validity_name = take("validity").value_or("clamp");
  const auto validity = std::ranges::find(validities(), std::string_view(validity_name), &ValidityInfo::name);
  if (validity == validities().end())
    return tl::unexpected(fmt::format("key 'validity' is '{}' but must be clamp, extrapolate or error", validity_name));
  validity_ = validity->validity;
  return {};
}

Result<void> Reader::read_law() {
  std::vector<std::pair<std::string, double>> values;
  for (const auto& p : law_->parameters)
    if (auto text = take(p.name)) {
      const auto value = number(p.name, *text, p.unit, p.minimum, p.maximum);
      if (!value) return tl::unexpected(fmt::format("law '{}': {}", law_->name, value.error().message));
      values.emplace_back(p.name, *value);
    }
  auto law = friction::make_law(law_->name, values);
  if (!law) return tl::unexpected(law.error());
  drive_.law = *law;
  drive_.law.validity = validity_;
  return {};
}

Result<void> Reader::read_numbers() {
  std::map<std::string_view, std::optional<double>> numbers;
  for (const Key& key : number_keys()) {
    const auto value = take_number(key, key.fallback[0] == '\0');
    if (!value) return tl::unexpected(value.error());
    numbers[key.name] = *value;
  }
  drive_.torque_max_nm = *numbers["torque_max_nm"];
  drive_.gear_ratio = *numbers["gear_ratio"];
  drive_.brake_torque_nm = numbers["brake_torque_nm"].value_or(0);
  drive_.load_filter_s = numbers["load_filter_s"].value_or(0);
  drive_.asymmetry = numbers["asymmetry"].value_or(0);
  drive_.offset_nm = numbers["offset_nm"].value_or(0);
  drive_.kp_nm_rad = numbers["kp"].value_or(0);
  drive_.kv_nm_s_rad = numbers["kv"].value_or(0);
  const bool servo = drive_.control == Control::position;
  if (servo && drive_.kp_nm_rad == 0)
    return tl::unexpected(std::string("key 'kp' must be above 0 [Nm/rad] with control 'position'"));
  if (!servo && (drive_.kp_nm_rad > 0 || drive_.kv_nm_s_rad > 0))
    return tl::unexpected(std::string("keys 'kp' and 'kv' belong to control 'position', but control is 'torque'"));
  T_amb_degC_ = numbers["T_amb"].value_or(T_amb_degC_);
  friction::Range& range = drive_.law.range;
  range.speed_max_rad_s = numbers["speed_max_rad_s"].value_or(range.speed_max_rad_s);
  range.load_max = numbers["load_max"].value_or(range.load_max);
  range.temperature_min_degC = numbers["temperature_min_degC"].value_or(range.temperature_min_degC);
  range.temperature_max_degC = numbers["temperature_max_degC"].value_or(range.temperature_max_degC);
  if (range.temperature_min_degC > range.temperature_max_degC)
    return tl::unexpected(fmt::format("temperature_min_degC {} lies above temperature_max_degC {}",
                                      range.temperature_min_degC, range.temperature_max_degC));
  return {};
}

Result<void> Reader::read_dynamics() {
  const auto targets = dynamics_values(drive_);
  for (std::size_t i = 0; i < dynamics_->keys.size(); ++i) {
    const auto value = take_number(dynamics_->keys[i], true);
    if (!value) return tl::unexpected(fmt::format("friction '{}': {}", dynamics_->name, value.error().message));
    *targets[i] = **value;
  }
  return {};
}

Result<void> Reader::read_load_table() {
  LoadTable& table = drive_.load_table;
  std::vector<double>* const lists[] = {&table.speeds_rad_s, &table.loads, &table.values};
  std::size_t given = 0;
  for (std::size_t i = 0; i < list_keys().size(); ++i) {
    const Key& key = list_keys()[i];
    const auto text = take(key.name);
    if (!text) continue;
    ++given;
    std::istringstream words(*text);
    for (std::string word; words >> word;) {
      const auto value = number(key.name, word, key.unit, key.minimum, key.maximum);
      if (!value) return tl::unexpected(value.error());
      lists[i]->push_back(*value);
    }
    const bool is_axis = lists[i] != &table.values;
    if (is_axis &&
        (lists[i]->empty() || std::ranges::adjacent_find(*lists[i], std::greater_equal<>()) != lists[i]->end()))
      return tl::unexpected(
          fmt::format("key '{}' is '{}' but must be ascending numbers [{}]", key.name, *text, key.unit));
  }
  if (given != 0 && given != list_keys().size())
    return tl::unexpected(std::string("a load table needs load_table_speeds, load_table_loads and load_table_values"));
  if (const std::size_t needed = table.speeds_rad_s.size() * table.loads.size(); table.values.size() != needed)
    return tl::unexpected(
        fmt::format("key 'load_table_values' has {} numbers but must have {}: a row of {} loads for each of {} speeds",
                    table.values.size(), needed, table.loads.size(), table.speeds_rad_s.size()));
  return {};
}

Result<void> Reader::read_thermal() {
  std::vector<double> values;
  for (const auto& p : thermal_->parameters) {
    const auto value = take_number(p, true);
    if (!value) return tl::unexpected(fmt::format("thermal '{}': {}", thermal_->name, value.error().message));
    values.push_back(**value);
  }
  drive_.thermal = thermal::make_model(thermal_->order, T_amb_degC_, values);
  return {};
}

Result<void> Reader::read_winding() {
  const auto keys = winding_keys();
  if (!left_.contains(keys.front().name)) {
    for (const Key& key : keys)
      if (left_.contains(key.name))
        return tl::unexpected(
            fmt::format("key '{}' belongs to a winding; give '{}', too, or remove it", key.name, keys.front().name));
    return {};
  }
  thermal::Winding& w = drive_.winding;
  const auto targets = winding_values(w);
  for (std::size_t i = 0; i < keys.size(); ++i) {
    const auto value = take_number(keys[i], keys[i].fallback[0] == '\0');
    if (!value) return tl::unexpected(value.error());
    *targets[i] = value->value_or(to_number(std::string_view(keys[i].fallback)).value_or(0));
  }
  if (w.current_max_A == 0) w.current_max_A = drive_.torque_max_nm / drive_.torque_per_current_nm_A();
  if (w.limit_degC <= w.warning_degC)
    return tl::unexpected(
        fmt::format("winding_limit_degC {} must lie above winding_warning_degC {}", w.limit_degC, w.warning_degC));
  if ((w.current_rated_A > 0) != (w.overload_s > 0))
    return tl::unexpected(std::string("I^2 t protection needs current_rated_A and overload_s"));
  if (w.current_rated_A >= w.current_max_A)
    return tl::unexpected(
        fmt::format("current_rated_A {} must lie below current_max_A {}", w.current_rated_A, w.current_max_A));
  return {};
}

Result<void> Reader::check_dynamics() const {
  if (drive_.dynamics == Dynamics::lugre)
    if (const auto wrong = bristles_that_push(drive_)) return tl::unexpected(*wrong);
  if (drive_.dynamics == Dynamics::gear_loss) {
    const auto& [mu_avg, mu_dif, length_rad] = drive_.gear_loss;
    if (std::abs(mu_dif) > mu_avg || (mu_avg + std::abs(mu_dif)) * (1 + std::abs(drive_.asymmetry)) >= 1)
      return tl::unexpected(fmt::format(
          "friction 'gear_loss': mu_avg {}, mu_dif {} must keep |mu_dif| <= mu_avg (friction opposes motion) "
          "and {} < 1 (the gear does not lock itself)",
          mu_avg, mu_dif, drive_.asymmetry == 0 ? "mu_avg + |mu_dif|" : "(mu_avg + |mu_dif|) (1 + |asymmetry|)"));
  }
  return {};
}

Result<void> Reader::check_all_known() const {
  if (left_.empty()) return {};
  std::vector<std::string_view> accepted;
  const auto add = [&](const auto& rows) {
    for (const auto& row : rows) accepted.push_back(row.name);
  };
  add(word_keys());
  add(number_keys());
  add(law_->parameters);
  add(thermal_->parameters);
  add(dynamics_->keys);
  add(list_keys());
  add(winding_keys());
  const std::string& unknown = left_.begin()->first;
  return tl::unexpected(
      fmt::format("key '{}' is not known for law '{}', thermal '{}' and friction '{}'; did you mean '{}'?", unknown,
                  law_->name, thermal_->name, dynamics_->name, nearest(unknown, accepted)));
}

Result<Drive> Reader::read(const Configuration& configuration) {
  for (const auto& [key, value] : configuration)
    if (!value.empty() && !left_.emplace(key, value).second)
      return tl::unexpected(fmt::format("key '{}' is given twice", key));
  for (const auto stage : {&Reader::choose_kinds, &Reader::read_law, &Reader::read_numbers, &Reader::read_dynamics,
                           &Reader::read_load_table, &Reader::read_thermal, &Reader::read_winding})
    if (auto ok = (this->*stage)(); !ok) return tl::unexpected(ok.error());
  if (auto ok = check_dynamics(); !ok) return tl::unexpected(ok.error());
  if (auto ok = check_all_known(); !ok) return tl::unexpected(ok.error());
  if (const auto wrong = self_locking(drive_)) return tl::unexpected(*wrong);
  return std::move(drive_);
}

}  // namespace

Result<Drive> make_drive(std::string name, const Configuration& configuration) {
  return Reader(std::move(name)).read(configuration);
}

Result<Drive> make_shared_drive(const std::string& instance, const std::string& joint,
                                const Configuration& configuration, std::size_t index, std::size_t count) {
  if (count == 1) return make_drive(instance, configuration);
  Configuration own;
  for (const auto& [key, value] : configuration) {
    std::istringstream words(value);
    const std::vector<std::string> values{std::istream_iterator<std::string>(words), {}};
    const bool for_all =
        values.size() == 1 || std::ranges::find(list_keys(), std::string_view(key), &Key::name) != list_keys().end();
    if (!for_all && !value.empty() && values.size() != count)
      return tl::unexpected(fmt::format("key '{}' has {} values but must have 1 for all or {}, one per actuator", key,
                                        values.size(), count));
    own.emplace_back(key, for_all || value.empty() ? value : values[index]);
  }
  return make_drive(instance + "/" + joint, own);
}

Configuration configuration_of(const Drive& drive) {
  Configuration c{{"law", std::string(drive.law.info->name)}};
  const auto add = [&c](std::string_view key, double value) { c.emplace_back(key, fmt::format("{}", value)); };
  const auto& info = *drive.law.info;
  for (std::size_t i = 0; i < info.parameters.size(); ++i) add(info.parameters[i].name, drive.law.parameters[i]);
  add("torque_max_nm", drive.torque_max_nm);
  add("gear_ratio", drive.gear_ratio);
  c.emplace_back("validity", std::ranges::find(validities(), drive.law.validity, &ValidityInfo::validity)->name);
  if (drive.dynamics != Dynamics::none) {
    const DynamicsInfo& how = *std::ranges::find(dynamics_table(), drive.dynamics, &DynamicsInfo::dynamics);
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
  const auto& model = thermal::info(drive.thermal.order);
  const auto values = model.values(drive.thermal);
  for (std::size_t i = 0; i < values.size(); ++i) add(model.parameters[i].name, values[i]);
  if (drive.winding.present()) {
    thermal::Winding copy = drive.winding;
    const auto numbers = winding_values(copy);
    for (std::size_t i = 0; i < numbers.size(); ++i)
      if (*numbers[i] != 0 || winding_keys()[i].minimum <= 0) add(winding_keys()[i].name, *numbers[i]);
  }
  add("brake_torque_nm", drive.brake_torque_nm);
  add("load_filter_s", drive.load_filter_s);
  if (drive.asymmetry != 0) add("asymmetry", drive.asymmetry);
  if (drive.offset_nm != 0) add("offset_nm", drive.offset_nm);
  if (drive.control == Control::position) {
    c.emplace_back("control", "position");
    add("kp", drive.kp_nm_rad);
    add("kv", drive.kv_nm_s_rad);
  }
  return c;
}

}  // namespace tribotwin::drive
