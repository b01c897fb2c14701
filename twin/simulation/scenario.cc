#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;

/// Of joints: rad, or m of a sliding one.
constexpr Bounds positions{-1e4, 1e4};
constexpr double longest_s = 1e9;         ///< of a run and of a cycle: thirty years
constexpr double most_cycle_steps = 1e7;  ///< of a wave, whose loop is kept step by step

/// Applies key=value to the tree; dotted keys descend, missing mappings are made.
void apply_override(YAML::Node root, const std::string& assignment) {
  const auto equals = assignment.find('=');
  if (equals == std::string::npos || equals == 0)
    throw InputError(fmt::format("--set {}: must be key=value, for example --set duration_s=60", assignment));
  std::vector<std::string> keys;
  std::string key;
  for (const char c : assignment.substr(0, equals) + ".")
    if (c == '.') {
      if (key.empty()) throw InputError(fmt::format("--set {}: an empty key", assignment));
      keys.push_back(std::exchange(key, {}));
    } else {
      key += c;
    }
  YAML::Node node;
  node.reset(root);
  for (std::size_t i = 0; i + 1 < keys.size(); ++i) {
    if (node.IsDefined() && !node.IsNull() && !node.IsMap())
      throw InputError(
          fmt::format("--set {}: '{}' is no mapping, so it has no key '{}'", assignment, keys[i - 1], keys[i]));
    node.reset(node[keys[i]]);
  }
  try {
    node[keys.back()] = YAML::Load(assignment.substr(equals + 1));
  } catch (const YAML::Exception& e) {
    throw InputError(fmt::format("--set {}: {}", assignment, e.msg));
  }
}

/// A path of the scenario made absolute, relative to the scenario's folder; the tree gets the absolute form.
fs::path absolute(const fs::path& folder, Mapping& mapping, YAML::Node node, const std::string& key) {
  const fs::path path = mapping.file(key, folder);
  node[key] = fs::absolute(path).string();
  return path;
}

std::shared_ptr<const mujoco::Model> checked(Result<std::shared_ptr<const mujoco::Model>> model) {
  if (!model) throw InputError(model.error().message);
  return *model;
}

/// Values per drive from a number for all, a list, or a mapping by joint name.
std::vector<double> per_drive(Mapping& in, const std::string& key, const mujoco::Model& model,
                              std::vector<double> values, Bounds bounds = {}) {
  const YAML::Node node = in.raw(key);
  if (!node) return values;
  if (node.IsScalar()) {
    std::ranges::fill(values, in.number(key, bounds));
  } else if (node.IsSequence()) {
    const auto list = in.numbers(key, bounds);
    if (list.size() != values.size())
      in.fail(key, fmt::format("has {} numbers, but the model has {} drives", list.size(), values.size()));
    values = list;
  } else {
    auto by_name = in.mapping(key);
    for (const auto& joint : by_name->names())
      values[drive_index(model, *by_name, joint, joint)] = by_name->number(joint, bounds);
  }
  return values;
}

DcPositionOptions dc_options(Mapping& in, const SetPoints* recording) {
  DcPositionOptions o;
  double kp = 400;
  if (recording)
    for (const auto& [name, value] : recording->numbers)
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

CompensatedOptions compensated_options(Mapping& in, const mujoco::Model& model, std::uint64_t seed) {
  CompensatedOptions o{.seed = seed};
  if (model.springs().empty())
    in.fail("type", "is compensated, but the model has no tribotwin.hysteresis: there is no torsion to compensate");
  o.loops = cascaded_options(in, {}, model);
  const std::string compensation = in.choice("compensation", {"none", "static", "proposed"});
  for (const auto c : {Compensation::none, Compensation::static_, Compensation::proposed})
    if (name_of(c) == compensation) o.compensator.compensation = c;
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

Motion motion_of(Mapping in, Scenario& s, const fs::path& folder, YAML::Node node) {
  const auto& model = *s.model;
  const std::string type = in.choice("type", {"hold", "cycle", "back_and_forth", "test_cycle", "recording"});
  const std::size_t n = model.drives().size();
  constexpr double deg = std::numbers::pi / 180;
  if (type == "hold") {
    in.done();
    return Motion(s.start_rad);
  }
  const auto limits = [&](const char* numeric) -> std::vector<double> {
    const int id = mj_name2id(model.get(), mjOBJ_NUMERIC, numeric);
    if (id < 0 || static_cast<std::size_t>(model->numeric_size[id]) != n) return std::vector<double>(n, 1);
    const mjtNum* data = model->numeric_data + model->numeric_adr[id];
    return {data, data + n};
  };
  if (type == "recording") {
    const fs::path path = absolute(folder, in, node, "file");
    auto points = read_set_points(path);
    if (!points) throw InputError(points.error().message);
    const double delay = in.number_or("delay_s", 0, {0, 10});
    in.done();
    std::vector<std::size_t> drives;
    if (points->joints.empty()) {
      if (n != 1) in.fail("file", fmt::format("is a recording of one joint, but the model has {} drives", n));
      drives.push_back(0);
    } else {
      for (const auto& joint : points->joints) drives.push_back(drive_index(model, in, "file", joint));
    }
    std::vector<double> start = s.start_rad;
    for (std::size_t k = 0; k < drives.size(); ++k)
      start[drives[k]] = points->measured_rad.empty() || !std::isfinite(points->measured_rad[0])
                             ? points->position_rad[k][0]
                             : points->measured_rad[0];
    s.start_rad = start;
    Motion motion(start);
    std::vector<double> velocity(n, 0.0);
    for (std::size_t i = 0; i < points->time_s.size(); ++i) {
      for (std::size_t k = 0; k < drives.size(); ++k) start[drives[k]] = points->position_rad[k][i];
      const double time = points->time_s[i] - points->time_s[0] + delay;
      if (points->velocity_rad_s.empty()) {
        motion.hold_at(time, start);
        continue;
      }
      for (std::size_t k = 0; k < drives.size(); ++k) velocity[drives[k]] = points->velocity_rad_s[k][i];
      motion.pass_through(time, start, velocity);
    }
    if (s.duration_s == 0) s.duration_s = points->time_s.back() - points->time_s[0];
    if (s.duration_s == 0) in.fail("file", "is a recording of a single instant, which lasts no time; give duration_s");
    s.recording = std::move(*points);
    return motion;
  }
  const double dwell = in.number_or("dwell_s", 0.2, {0, 1e6});
  if (type == "cycle") {
    const double share = in.number_or("speed_share", 0.8, {1e-6, 1});
    std::vector<double> speed = limits("joint_speed_max_rad_s");
    for (double& v : speed) v *= share;
    speed = per_drive(in, "speed_rad_s", model, speed, {1e-9, 1e6});
    std::vector<double> acceleration(n);
    for (std::size_t j = 0; j < n; ++j) acceleration[j] = speed[j] / in.number_or("ramp_s", 0.4, {1e-3, 1e3});
    const auto points = in.mappings("waypoints");
    const bool repeat = in.flag_or("repeat", true);
    in.done();
    if (points.size() < 2) in.fail("waypoints", "needs at least two poses, each a mapping with position_rad");
    std::vector<std::vector<double>> poses;
    for (Mapping point : points) {
      poses.push_back(per_drive(point, "position_rad", model, poses.empty() ? s.start_rad : poses.back(), positions));
      point.done();
    }
    s.start_rad = poses.front();
    Motion motion(poses.front());
    for (std::size_t i = 1; i < poses.size(); ++i) motion.move_to(poses[i], speed, acceleration).dwell(dwell);
    if (repeat) motion.move_to(poses.front(), speed, acceleration).dwell(dwell).repeat(model->opt.timestep);
    return motion;
  }
  if (type == "back_and_forth") {
    const std::size_t joint = drive_index(model, in, "joint", in.text("joint"));
    const double travel = in.number("travel_rad", {1e-9, 1e4}), speed = in.number("speed_rad_s", {1e-9, 1e4});
    const double acceleration = in.number_or("acceleration_rad_s2", 10, {1e-6, 1e6});
    const bool repeat = in.flag_or("repeat", true);
    in.done();
    Motion motion = back_and_forth(s.start_rad, joint, travel, speed, acceleration, dwell);
    s.start_rad.assign(motion.start_rad().begin(), motion.start_rad().end());
    if (repeat) motion.repeat(model->opt.timestep);
    return motion;
  }
  std::vector<std::size_t> joints;
  const YAML::Node list = in.raw("joints");
  if (!list || !list.IsSequence() || list.size() == 0) in.fail("joints", "must be a list of joint names");
  for (const auto& name : list) joints.push_back(drive_index(model, in, "joints", name.Scalar()));
  const double acceleration = in.number_or("acceleration_rad_s2", 400 * deg, {1e-6, 1e6});
  in.done();
  Motion motion = test_cycle(s.start_rad, joints, acceleration, dwell);
  if (s.duration_s == 0) s.duration_s = motion.duration_s();
  return motion;
}

Event event_of(Mapping in, const mujoco::Model& model, double duration_s) {
  Event event;
  event.time_s = in.number("time_s", {0, duration_s});
  const std::string type = in.choice("type", {"payload", "ambient", "wear", "fault"});
  if (type == "payload") {
    Payload p{.mass_kg = in.number("mass_kg", {0, 1e6})};
    if (in.has("com_m")) {
      const auto com = in.numbers("com_m", {-1e3, 1e3});
      if (com.size() != 3) in.fail("com_m", "must be three numbers [x, y, z]");
      std::ranges::copy(com, p.com_m.begin());
    }
    event.what = PayloadChange{checked(with_payload(model, p))};
  } else if (type == "ambient") {
    event.what = AmbientChange{in.number("temperature_degC", {-100, 300})};
  } else if (type == "fault") {
    const std::size_t drive = drive_index(model, in, "joint", in.text("joint"));
    const double growth_per_h = in.number_or("growth_per_h", 0, {0, 1e6});
    const auto fault = fault_of(in, "fault", model, drive, growth_per_h * (duration_s - event.time_s) / 3600);
    event.what = FaultChange{drive, fault.type, fault.severity, growth_per_h};
  } else {
    event.what = read_wear(in, model);
  }
  in.done();
  return event;
}

}  // namespace

double Wave::operator()(double t) const {
  return offset + amplitude * std::sin(2 * std::numbers::pi * frequency_hz * t + phase_rad);
}

Wear read_wear(Mapping& in, const mujoco::Model& model) {
  Wear wear{.joint = in.text("joint")};
  const auto& law = model.drives()[drive_index(model, in, "joint", wear.joint)].drive.law;
  auto factors = in.mapping("factors");
  if (!factors) in.fail("factors", "is missing: a mapping from parameters of the law to factors");
  for (const auto& name : factors->names()) {
    std::vector<std::string_view> accepted;
    for (const auto& p : law.info->parameters) accepted.push_back(p.name);
    if (std::ranges::find(accepted, name) == accepted.end())
      factors->fail(name, fmt::format("is no parameter of law '{}'; did you mean '{}'?", law.info->name,
                                      friction::nearest(name, accepted)));
    wear.factors[name] = factors->number(name, {0, 1000});
  }
  return wear;
}

std::size_t drive_index(const mujoco::Model& model, const Mapping& mapping, const std::string& key,
                        const std::string& joint) {
  const auto found = find_drive(model, joint);
  if (!found) mapping.fail(key, found.error().message);
  return *found;
}

FaultSetting fault_of(Mapping& in, const std::string& type_key, const mujoco::Model& model, std::size_t drive,
                      double growth) {
  std::vector<std::string_view> names;
  for (const auto& fault : drive::faults()) names.push_back(fault.name);
  const drive::FaultInfo* type = drive::find_fault(in.choice(type_key, names));
  const double severity = in.number("severity", {0, type->maximum}), most = severity + growth;
  if (most > type->maximum)
    in.fail("growth_per_h", fmt::format("makes a severity of {:.4g} by the end, but that of '{}' is {:g} at most", most,
                                        type->name, type->maximum));
  drive::Faults faults{};
  type->add(faults, most);
  const auto& binding = model.drives()[drive];
  drive::Drive faulty = binding.drive;
  faulty.law = drive::with_faults(faulty.law, faults);
  if (auto carried = mujoco::bind(model.get(), faulty, binding.actuator); !carried)
    in.fail("severity", fmt::format("of {:.4g} is more than can be simulated: {}", most, carried.error().message));
  return {type, severity};
}

Scenario load_scenario(const fs::path& file, const std::vector<std::string>& overrides) {
  YAML::Node root = load_yaml(file);
  for (const auto& assignment : overrides) apply_override(root, assignment);
  if (root.IsMap()) root.remove("vary");  // `tribotwin run` makes overrides of it
  const fs::path folder = fs::absolute(file).parent_path();

  Scenario s;
  s.file = file;
  Mapping in(file.string(), "", root);
  in.accept({"name",
             "description",
             "seed",
             "timestep_s",
             "integrator",
             "solver",
             "model",
             "duration_s",
             "telemetry_rate_hz",
             "keyframe",
             "start_rad",
             "ambient_degC",
             "temperature_degC",
             "motion",
             "control",
             "actuators",
             "multirate",
             "events",
             "baseline",
             "vary"});
  s.name = in.file_name_or("name", file.stem().string());
  root["name"] = s.name;
  s.description = in.text_or("description", "");
  s.seed = in.whole_or("seed", 1, {0, 9007199254740992.0});
  mujoco::Options options;
  if (in.has("timestep_s"))
    options.timestep_s = in.number("timestep_s", {mujoco::shortest_timestep_s, mujoco::longest_timestep_s});
  if (in.has("integrator")) options.integrator = in.text("integrator");
  if (in.has("solver")) options.solver = in.text("solver");
  s.model = checked(mujoco::load_file(absolute(folder, in, root, "model"), options));
  if (s.model->drives().empty()) in.fail("model", "has no tribotwin.drive");
  s.duration_s = in.number_or("duration_s", 0, {mujoco::shortest_timestep_s, longest_s});
  s.telemetry_rate_hz = in.number_or("telemetry_rate_hz", 100, {1e-6, 1e6});

  const auto& model = *s.model;
  const std::size_t n = model.drives().size();
  s.start_rad.assign(n, 0.0);
  if (in.has("keyframe")) {
    const std::string key = in.text("keyframe");
    const int id = mj_name2id(model.get(), mjOBJ_KEY, key.c_str());
    if (id < 0) in.fail("keyframe", fmt::format("the model has no keyframe '{}'", key));
    for (std::size_t j = 0; j < n; ++j)
      s.start_rad[j] = model->key_qpos[id * model->nq + position_address(model.get(), model.drives()[j])];
  }
  s.start_rad = per_drive(in, "start_rad", model, s.start_rad, positions);

  if (in.has("ambient_degC")) s.ambient_degC = in.number("ambient_degC", {-100, 300});
  s.temperature_degC.resize(n);
  for (std::size_t j = 0; j < n; ++j)
    s.temperature_degC[j] = s.ambient_degC.value_or(model.drives()[j].drive.thermal.T_amb_degC);

  if (auto motion = in.mapping("motion")) s.motion = motion_of(*motion, s, folder, root["motion"]);
  for (std::size_t j = 0; j < n; ++j) {
    const auto& drive = model.drives()[j];
    if (!model->jnt_limited[drive.joint]) continue;
    const double low = model->jnt_range[2 * drive.joint], high = model->jnt_range[2 * drive.joint + 1];
    const auto [least, most] = s.motion ? s.motion->reach_rad(j) : std::pair{s.start_rad[j], s.start_rad[j]};
    if (!(least >= low - 1e-9 && most <= high + 1e-9))
      in.fail(s.motion ? "motion" : "start_rad",
              fmt::format("takes {} to {:.4g} .. {:.4g} rad, but its range is {:.4g} .. {:.4g} rad",
                          joint_name(model.get(), drive), least, most, low, high));
  }
  if (s.duration_s == 0) in.fail("duration_s", "is missing");
  if (!(s.duration_s >= model->opt.timestep && s.duration_s <= longest_s))
    in.fail("duration_s", fmt::format("is {:g} s but must be within a time step, {:g} s, and {:g} s", s.duration_s,
                                      model->opt.timestep, longest_s));
  if (s.motion && s.motion->period_s() > longest_s)
    in.fail("motion", fmt::format("takes {:.3g} s a cycle, at most {:g} s are possible; move faster or less far",
                                  s.motion->period_s(), longest_s));
  if (s.recording && !s.recording->temperature_degC.empty() && std::isfinite(s.recording->temperature_degC[0]))
    s.temperature_degC[0] = s.recording->temperature_degC[0];
  s.temperature_degC = per_drive(in, "temperature_degC", model, s.temperature_degC, {-100, 300});

  auto control = in.mapping("control");
  if (!control) {
    if (!s.motion) in.fail("control", "is missing: without a motion it must be of type torque");
    s.control = CascadedOptions{};
  } else {
    const std::string type = control->choice("type", {"servo", "compensated", "dc_position", "torque"});
    if (type == "servo") {
      s.control = cascaded_options(*control, {}, model);
    } else if (type == "compensated") {
      s.control = compensated_options(*control, model, s.seed);
    } else if (type == "dc_position") {
      s.control = dc_options(*control, s.recording ? &*s.recording : nullptr);
    } else {
      s.control = per_drive(*control, "torque_nm", model, std::vector<double>(n, 0.0), {-1e9, 1e9});
    }
    control->done();
    if (type != "torque" && !s.motion) in.fail("motion", "is missing: what should the joints do?");
  }
  if (auto actuators = in.mapping("actuators")) {
    std::vector<std::string> names;
    std::vector<int> controls;
    for (int a = 0; a < model->nu; ++a)
      if (std::ranges::none_of(model.drives(), [a](const auto& drive) { return drive.actuator == a; }) &&
          std::ranges::none_of(model.springs(), [a](const auto& spring) { return spring.actuator == a; }))
        names.emplace_back(model->names + model->name_actuatoradr[a]),
            controls.push_back(mujoco::engine::control_address(model.get(), a));
    const std::vector<std::string_view> accepted(names.begin(), names.end());
    for (const auto& name : actuators->names()) {
      const auto found = std::ranges::find(names, name);
      if (found == names.end())
        actuators->fail(name, names.empty()
                                  ? "is no actuator of the model beside its drives; it has none"
                                  : fmt::format("is no actuator of the model beside its drives; did you mean '{}'?",
                                                friction::nearest(name, accepted)));
      auto wave = actuators->mapping(name);
      if (!wave) actuators->fail(name, "must be a mapping: offset, amplitude, frequency_hz, phase_rad");
      s.waves.push_back({.control = controls[static_cast<std::size_t>(found - names.begin())],
                         .offset = wave->number_or("offset", 0, {-1e9, 1e9}),
                         .amplitude = wave->number_or("amplitude", 0, {-1e9, 1e9}),
                         .frequency_hz = wave->number_or("frequency_hz", 0, {0, 1e6}),
                         .phase_rad = wave->number_or("phase_rad", 0, {-1e6, 1e6})});
      if (const double steps = 1 / (s.waves.back().frequency_hz * model->opt.timestep);
          std::isfinite(steps) && steps > most_cycle_steps)
        wave->fail(
            "frequency_hz",
            fmt::format("is {} but must be 0 or at least {:.2g}: a period may have {:g} time steps",
                        s.waves.back().frequency_hz, 1 / (most_cycle_steps * model->opt.timestep), most_cycle_steps));
      wave->done();
    }
  }
  if (auto multirate = in.mapping("multirate")) {
    s.multirate.enabled = multirate->flag_or("enabled", true);
    s.multirate.tolerance_K = multirate->number_or("tolerance_K", s.multirate.tolerance_K, {1e-6, 1000});
    multirate->done();
    if (s.multirate.enabled && (!s.motion || s.motion->period_s() == 0))
      in.fail("multirate", "needs a motion that repeats (cycle or back_and_forth)");
  }
  for (Mapping event : in.mappings("events")) s.events.push_back(event_of(event, model, s.duration_s));
  std::ranges::stable_sort(s.events, {}, &Event::time_s);
  if (auto baseline = in.mapping("baseline")) {
    YAML::Node node = root["baseline"];
    s.baseline = checked(mujoco::load_file(absolute(folder, *baseline, node, "model"), options));
    s.baseline_control = dc_options(*baseline, s.recording ? &*s.recording : nullptr);
    s.baseline_delay_s = baseline->number_or("delay_s", 0, {0, 10});
    baseline->done();
    if (!s.recording || s.recording->measured_rad.empty() ||
        !std::ranges::all_of(s.recording->measured_rad, [](double q) { return std::isfinite(q); }))
      in.fail("baseline", "needs a recording with measured positions in all entries");
    if ((*s.baseline)->nu != 1 || (*s.baseline)->nq != 1)
      in.fail("baseline", "its model must have one joint and one motor");
  }
  in.done();
  s.resolved_yaml = to_text(root);
  return s;
}

}  // namespace tribotwin::twin
