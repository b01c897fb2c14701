#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/simulation/scenario_input.hpp>

namespace tribotwin::twin {
namespace {

/// Loops that differ between the drives: gains per joint, and those that only a drive's own numbers can be.
std::vector<LoopGains> loop_gains(Mapping& in, const mujoco::Model& model) {
  const LoopGains o;
  const auto read = [&](const char* key, double fallback, Bounds bounds) {
    return per_drive(in, key, model, std::vector(model.drives().size(), fallback), bounds);
  };
  const auto position = read("position_gain_1_s", o.position_gain_1_s, {0, 1e6}),
             bandwidth = read("speed_bandwidth_rad_s", o.speed_bandwidth_rad_s, {1e-6, 1e6}),
             integral = read("integral_time_s", o.integral_time_s, {0, 1e6}),
             gain = read("speed_gain_nm_s_rad", o.speed_gain_nm_s_rad, {0, 1e9}),
             limit = read("torque_limit_nm", o.torque_limit_nm, {0, friction::unlimited});
  std::vector<LoopGains> all;
  for (std::size_t i = 0; i < position.size(); ++i) {
    if (bandwidth[i] * model->opt.timestep > 1)
      in.fail("speed_bandwidth_rad_s",
              fmt::format("is above 1 / time step = {:g} rad/s and would be unstable", 1 / model->opt.timestep));
    all.push_back({position[i], bandwidth[i], integral[i], gain[i], limit[i]});
  }
  return all;
}

CascadedOptions cascaded_options(Mapping& in, CascadedOptions o, const mujoco::Model& model) {
  o.gravity = in.flag_or("gravity", o.gravity);
  o.encoder_counts = in.number_or("encoder_counts", o.encoder_counts, {0, 1e12});
  o.speed_filter_rad_s = in.number_or("speed_filter_rad_s", o.speed_filter_rad_s, {1e-6, 1e9});
  o.per_drive = loop_gains(in, model);
  if (o.per_drive.empty()) return o;
  // Drives whose loops take no gains of their own (the compensator's, a bus) have those of the first.
  o.position_gain_1_s = o.per_drive[0].position_gain_1_s;
  o.speed_bandwidth_rad_s = o.per_drive[0].speed_bandwidth_rad_s;
  o.integral_time_s = o.per_drive[0].integral_time_s;
  return o;
}

const std::pair<std::string_view, Compensation> compensations[] = {
    {name_of(Compensation::none), Compensation::none},
    {name_of(Compensation::static_), Compensation::static_},
    {name_of(Compensation::proposed), Compensation::proposed},
};

CompensatedOptions compensated_options(Mapping& in, const mujoco::Model& model, std::uint64_t seed) {
  CompensatedOptions o{.seed = seed};
  if (model.springs().empty())
    in.fail("type", "is compensated, but the model has no tribotwin.hysteresis: there is no torsion to compensate");
  o.loops = cascaded_options(in, {}, model);
  o.compensator.compensation = choice_of(in, "compensation", compensations);
  o.compensator.observer_gain_1_s =
      in.number_or("observer_gain_1_s", o.compensator.observer_gain_1_s, {1e-6, 1 / model->opt.timestep});
  o.compensator.friction_gain_rad_nm_s =
      in.number_or("friction_gain_rad_nm_s", o.compensator.friction_gain_rad_nm_s, {0, 1e6});
  o.compensator.dead_zone_rad = in.number_or("dead_zone_rad", o.compensator.dead_zone_rad, {0, 1});
  o.compensator.reference_temperature_degC =
      in.number_or("reference_temperature_degC", o.compensator.reference_temperature_degC, {-100, 300});
  o.identification_error = in.number_or("identification_error", o.identification_error, {0, 0.3});
  return o;
}

using Control = decltype(Scenario::control);

/// One row per type of control.
constexpr std::pair<std::string_view, Control (*)(Mapping&, const Scenario&)> control_types[] = {
    {"servo", [](Mapping& in, const Scenario& s) -> Control { return cascaded_options(in, {}, *s.model); }},
    {"compensated",
     [](Mapping& in, const Scenario& s) -> Control { return compensated_options(in, *s.model, s.seed); }},
    {"dc_position", [](Mapping& in, const Scenario& s) -> Control { return dc_position_options(in, s); }},
    {"torque",
     [](Mapping& in, const Scenario& s) -> Control {
       return per_drive(in, "torque_nm", *s.model, std::vector<double>(s.model->drives().size(), 0.0), {-1e9, 1e9});
     }},
};

}  // namespace

std::vector<DcPositionOptions> dc_position_options(Mapping& in, const Scenario& s) {
  const DcPositionOptions o;
  double kp = o.kp;
  if (s.recording)
    for (const auto& [name, value] : s.recording->numbers)
      if (name == "kp") kp = value;
  if (!(kp >= 0 && kp <= 1e9)) in.fail("kp", fmt::format("is {} in the recording but must be within 0 .. 1e9", kp));
  struct Row {
    const char* key;
    double DcPositionOptions::*value;
    double fallback;  ///< NaN: required
    Bounds bounds;
  };
  const double required = std::nan("");
  const Row rows[] = {
      {"kp", &DcPositionOptions::kp, kp, {0, 1e9}},
      {"error_gain", &DcPositionOptions::error_gain, required, {0, 1e9}},
      {"duty_limit", &DcPositionOptions::duty_limit, o.duty_limit, {0, 1}},
      {"duty_slew_1_s", &DcPositionOptions::duty_slew_1_s, o.duty_slew_1_s, {1e-3, friction::unlimited}},
      {"supply_V", &DcPositionOptions::supply_V, required, {0, 1e6}},
      {"resistance_ohm", &DcPositionOptions::resistance_ohm, required, {1e-9, 1e9}},
      {"supply_resistance_ohm", &DcPositionOptions::supply_resistance_ohm, 0, {0, 1e9}},
      {"kt_nm_A", &DcPositionOptions::kt_nm_A, required, {0, 1e6}},
      {"torque_limit_nm", &DcPositionOptions::torque_limit_nm, o.torque_limit_nm, {0, friction::unlimited}},
      {"resistance_per_K", &DcPositionOptions::resistance_per_K, 0, {-0.1, 0.1}},
      {"reference_degC", &DcPositionOptions::reference_degC, o.reference_degC, {-100, 300}},
  };
  std::vector<DcPositionOptions> all(s.model->drives().size());
  for (const Row& row : rows) {
    if (std::isnan(row.fallback) && !in.has(row.key)) in.number(row.key);  // says that it is missing
    const auto values = per_drive(in, row.key, *s.model, std::vector(all.size(), row.fallback), row.bounds);
    for (std::size_t i = 0; i < all.size(); ++i) all[i].*row.value = values[i];
  }
  for (const auto& one : all)
    if (one.supply_resistance_ohm > one.resistance_ohm)
      in.fail("supply_resistance_ohm", fmt::format("is {:g} but must be within 0 .. {:g}, resistance_ohm: a supply "
                                                   "loses less than the whole voltage",
                                                   one.supply_resistance_ohm, one.resistance_ohm));
  return all;
}

void read_control(Mapping& in, Scenario& s) {
  auto control = in.mapping("control");
  if (!control) {
    if (!s.motion) in.fail("control", "is missing: without a motion it must be of type torque");
    s.control = CascadedOptions{};
    return;
  }
  s.control = choice_of(*control, "type", control_types)(*control, s);
  control->done();
  if (!std::holds_alternative<std::vector<double>>(s.control) && !s.motion)
    in.fail("motion", "is missing: what should the joints do?");
}

}  // namespace tribotwin::twin
