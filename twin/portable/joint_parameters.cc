#include <algorithm>
#include <cmath>

#include <tribotwin/plugins/drive/keys.hpp>
#include <tribotwin/twin/portable/joint_parameters.hpp>

namespace tribotwin::twin {
namespace {

/// The keys of its winding that count: those of I^2 t protection only where it has one.
std::vector<std::pair<const Key*, double>> winding_numbers(const drive::Drive& d) {
  std::vector<std::pair<const Key*, double>> all;
  if (!d.winding.present()) return all;
  thermal::Winding winding = d.winding;
  const auto values = drive::winding_values(winding);
  for (std::size_t i = 0; i < values.size(); ++i) {
    const bool of_protection = values[i] == &winding.current_rated_A || values[i] == &winding.overload_s;
    if (!of_protection || winding.current_rated_A > 0) all.emplace_back(&drive::winding_keys()[i], *values[i]);
  }
  return all;
}

/// Values from which `place` makes exactly this model. Those of `thermal::values` may miss it by a rounding.
std::vector<double> exact_values(const thermal::Model& model) {
  const std::vector<double> values = thermal::values(model);
  const auto same = [&](const std::vector<double>& tried) {
    const thermal::Model made = thermal::make_model(model.order, model.T_amb_degC, tried);
    return std::ranges::equal(made.t_s, model.t_s) && std::ranges::equal(made.gain_K_J, model.gain_K_J);
  };
  for (std::size_t i = 0; i < values.size(); ++i)
    for (const double towards : {values[i], HUGE_VAL, -HUGE_VAL}) {
      std::vector<double> tried = values;
      tried[i] = std::nextafter(values[i], towards);
      if (same(tried)) return tried;
    }
  return values;
}

}  // namespace

std::vector<JointParameter> joint_parameters(const drive::Drive& d) {
  std::vector<JointParameter> all;
  const std::string law_unit = d.law.info->normalised ? "1" : "Nm";
  const auto add = [&](const auto& row, double value) {
    std::string unit = row.unit;
    if (unit.starts_with("law")) unit.replace(0, 3, law_unit);
    all.push_back({row.name, unit, value, row.minimum, row.maximum, row.meaning});
  };
  for (std::size_t i = 0; i < d.law.info->parameters.size(); ++i) {
    const friction::Parameter& p = d.law.info->parameters[i];
    all.push_back({p.name, std::string(p.unit), d.law.parameters[i], p.minimum, p.maximum, p.meaning});
  }
  const std::pair<std::string_view, double> own[] = {{"torque_max_nm", d.torque_max_nm},
                                                     {"gear_ratio", d.gear_ratio},
                                                     {"load_filter_s", d.load_filter_s},
                                                     {"asymmetry", d.asymmetry}};
  const auto add_own = [&](std::string_view name, double value) {
    add(*std::ranges::find(drive::number_keys(), name, [](const Key& key) { return std::string_view(key.name); }),
        value);
  };
  for (const auto& [name, value] : own) add_own(name, value);
  drive::Drive copy = d;
  const auto values = drive::dynamics_values(copy);
  for (const drive::DynamicsInfo& info : drive::dynamics_table())
    if (info.dynamics == d.dynamics)
      for (std::size_t i = 0; i < info.keys.size(); ++i) add(info.keys[i], *values[i]);
  const std::vector<double> heat = exact_values(d.thermal);
  for (std::size_t i = 0; i < heat.size(); ++i) {
    const thermal::Parameter& p = thermal::parameters(d.thermal.order)[i];
    all.push_back({p.name, std::string(p.unit), heat[i], p.minimum, p.maximum, p.meaning});
  }
  if (d.winding.present()) add_own("offset_nm", d.offset_nm);  // a part of what its current bears
  for (const auto& [key, value] : winding_numbers(d)) add(*key, value);
  return all;
}

}  // namespace tribotwin::twin
