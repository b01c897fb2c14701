#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/control/dc_position_keys.hpp>
#include <tribotwin/twin/simulation/scenario_input.hpp>

namespace tribotwin::twin {
namespace {

using Mode = DriveCommand::Mode;

/// Loops that differ between the drives: gains per joint, and those that only a drive's own numbers can be. Keys of
/// loops that the mode goes past are left unread.
std::vector<LoopGains> loop_gains(Mapping& in, const mujoco::Model& model, Mode mode) {
  const LoopGains o;
  const auto read = [&](const char* key, double fallback, Bounds bounds) {
    return per_drive(in, key, model, std::vector(model.drives().size(), fallback), bounds);
  };
  const auto read_for = [&](bool read_it, const char* key, double fallback, Bounds bounds) {
    return read_it ? read(key, fallback, bounds) : std::vector(model.drives().size(), fallback);
  };
  const bool speeds = mode != Mode::torque;
  const auto position = read_for(mode == Mode::position, "position_gain_1_s", o.position_gain_1_s, {0, 1e6}),
             bandwidth = read_for(speeds, "speed_bandwidth_rad_s", o.speed_bandwidth_rad_s, {1e-6, 1e6}),
             integral = read_for(speeds, "integral_time_s", o.integral_time_s, {0, 1e6}),
             gain = read_for(speeds, "speed_gain_nm_s_rad", o.speed_gain_nm_s_rad, {0, 1e9}),
             limit = read("torque_limit_nm", o.torque_limit_nm, {0, friction::unlimited}),
             torque = read("torque_gain", o.torque_gain, {0, 1e6});
  std::vector<LoopGains> all;
  for (std::size_t i = 0; i < position.size(); ++i) {
    if (speeds && bandwidth[i] * model->opt.timestep > 1)
      in.fail("speed_bandwidth_rad_s",
              fmt::format("is above 1 / time step = {:g} rad/s and would be unstable", 1 / model->opt.timestep));
    all.push_back({position[i], bandwidth[i], integral[i], gain[i], limit[i], torque[i]});
  }
  return all;
}

CascadedOptions cascaded_options(Mapping& in, CascadedOptions o, const mujoco::Model& model) {
  if (o.mode != Mode::torque) o.gravity = in.flag_or("gravity", o.gravity);
  o.encoder_counts = in.number_or("encoder_counts", o.encoder_counts, {0, 1e12});
  o.speed_filter_rad_s = in.number_or("speed_filter_rad_s", o.speed_filter_rad_s, {1e-6, 1e9});
  o.per_drive = loop_gains(in, model, o.mode);
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

Control velocity_control(Mapping& in, const Scenario& s) {
  if (s.recording && s.recording->command_rad_s.empty() && s.recording->velocity_rad_s.empty())
    in.fail("type", "is velocity, but the recording has no set_point_JOINT_rad_s (_m_s)");
  return cascaded_options(in, {.mode = Mode::velocity}, *s.model);
}

/// Constant torques, or those that a recording commands.
Control torque_control(Mapping& in, const Scenario& s) {
  if (!in.has("torque_nm") && s.recording && !s.recording->command_nm.empty())
    return cascaded_options(in, {.mode = Mode::torque}, *s.model);
  return per_drive(in, "torque_nm", *s.model, std::vector<double>(s.model->drives().size(), 0.0), {-1e9, 1e9});
}

/// One row per type of control.
constexpr std::pair<std::string_view, Control (*)(Mapping&, const Scenario&)> control_types[] = {
    {"servo", [](Mapping& in, const Scenario& s) -> Control { return cascaded_options(in, {}, *s.model); }},
    {"compensated",
     [](Mapping& in, const Scenario& s) -> Control { return compensated_options(in, *s.model, s.seed); }},
    {"dc_position", [](Mapping& in, const Scenario& s) -> Control { return dc_position_options(in, s); }},
    {"velocity", velocity_control},
    {"torque", torque_control},
};

}  // namespace

std::vector<DcPositionOptions> dc_position_options(Mapping& in, const Scenario& s) {
  double kp = DcPositionOptions{}.kp;
  if (s.recording)
    for (const auto& [name, value] : s.recording->numbers)
      if (name == "kp") kp = value;
  if (!(kp >= 0 && kp <= 1e9)) in.fail("kp", fmt::format("is {} in the recording but must be within 0 .. 1e9", kp));
  std::vector<DcPositionOptions> all;
  for (const mujoco::Binding& binding : s.model->drives()) {
    DcPositionOptions& one = all.emplace_back(DcPositionOptions{.kp = kp});
    if (const thermal::Winding& w = binding.drive.winding; w.present())
      one.resistance_per_K = w.copper_1_K, one.reference_degC = w.reference_degC;
  }
  for (const DcPositionKey& key : dc_position_keys()) {
    if (!in.has(key.name)) {
      if (key.required) in.number(key.name);  // says that it is missing
      continue;
    }
    std::vector<double> values;
    for (DcPositionOptions& one : all) values.push_back(key.value(one));
    values = per_drive(in, key.name, *s.model, values, {key.minimum, key.maximum});
    for (std::size_t i = 0; i < all.size(); ++i) key.value(all[i]) = values[i];
  }
  for (const auto& one : all)
    if (const std::string why = problem_of(one); !why.empty())
      in.fail(why.substr(0, why.find(": ")), why.substr(why.find(": ") + 2));
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
  const auto* servo = std::get_if<CascadedOptions>(&s.control);
  const bool follows_positions = std::holds_alternative<std::vector<DcPositionOptions>>(s.control) ||
                                 std::holds_alternative<CompensatedOptions>(s.control) ||
                                 (servo != nullptr && servo->mode == Mode::position);
  if (follows_positions && s.recording && s.recording->position_rad.empty())
    control->fail("type",
                  "follows positions, but the recording has none; its commands are speeds (type: velocity) or "
                  "torques (type: torque)");
  if (!std::holds_alternative<std::vector<double>>(s.control) && !s.motion)
    in.fail("motion", "is missing: what should the joints do?");
}

}  // namespace tribotwin::twin
