#include <algorithm>

#include <fmt/format.h>

#include <tribotwin/twin/simulation/scenario_input.hpp>

namespace tribotwin::twin {
namespace {

CascadedOptions cascaded_options(Mapping& in, CascadedOptions o, const mujoco::Model& model) {
  o.position_gain_1_s = in.number_or("position_gain_1_s", o.position_gain_1_s, {0, 1e6});
  o.speed_bandwidth_rad_s = in.number_or("speed_bandwidth_rad_s", o.speed_bandwidth_rad_s, {1e-6, 1e6});
  o.integral_time_s = in.number_or("integral_time_s", o.integral_time_s, {0, 1e6});
  o.gravity = in.flag_or("gravity", o.gravity);
  o.encoder_counts = in.number_or("encoder_counts", o.encoder_counts, {0, 1e12});
  o.speed_filter_rad_s = in.number_or("speed_filter_rad_s", o.speed_filter_rad_s, {1e-6, 1e9});
  if (o.speed_bandwidth_rad_s * model->opt.timestep > 1)
    in.fail("speed_bandwidth_rad_s",
            fmt::format("is above 1 / time step = {:g} rad/s and would be unstable", 1 / model->opt.timestep));
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

DcPositionOptions dc_position_options(Mapping& in, const Scenario& s) {
  DcPositionOptions o;
  double kp = 400;
  if (s.recording)
    for (const auto& [name, value] : s.recording->numbers)
      if (name == "kp") kp = value;
  if (!(kp >= 0 && kp <= 1e9)) in.fail("kp", fmt::format("is {} in the recording but must be within 0 .. 1e9", kp));
  o.kp = in.number_or("kp", kp, {0, 1e9});
  o.error_gain = in.number("error_gain", {0, 1e9});
  o.supply_V = in.number("supply_V", {0, 1e6});
  o.resistance_ohm = in.number("resistance_ohm", {1e-9, 1e9});
  o.supply_resistance_ohm = in.number_or("supply_resistance_ohm", 0, {0, o.resistance_ohm});
  o.kt_nm_A = in.number("kt_nm_A", {0, 1e6});
  o.torque_limit_nm = in.number_or("torque_limit_nm", friction::unlimited, {0, 1e9});
  return o;
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
