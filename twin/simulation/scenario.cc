#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/text.hpp>
#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/drive_change.hpp>
#include <tribotwin/twin/simulation/health.hpp>
#include <tribotwin/twin/simulation/scenario_input.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;

constexpr double max_period_steps = 1e7;  ///< of a wave, whose loop is kept step by step

/// Every key of a scenario. `vary` belongs to `tribotwin run`, which makes settings of it.
constexpr std::string_view keys[] = {"name",
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
                                     "expects",
                                     "vary",
                                     "drives",
                                     "robot",
                                     "serial_number"};

mujoco::Options engine_options(Mapping& in) {
  mujoco::Options options;
  if (in.has("timestep_s"))
    options.timestep_s = in.number("timestep_s", {mujoco::shortest_timestep_s, mujoco::longest_timestep_s});
  if (in.has("integrator")) options.integrator = in.text("integrator");
  if (in.has("solver")) options.solver = in.text("solver");
  return options;
}

/// Keys of drives that replace those of the model.
std::vector<DriveChange> drive_changes(Mapping& in) {
  std::vector<DriveChange> changes;
  auto drives = in.mapping("drives");
  if (!drives) return changes;
  for (const auto& joint : drives->names()) {
    auto of_joint = drives->mapping(joint);
    if (!of_joint) drives->fail(joint, "must be a mapping of the drive's keys, for example {Fc0: 0.03}");
    DriveChange& change = changes.emplace_back(DriveChange{.joint = joint, .keys = {}});
    for (const auto& key : of_joint->names()) change.keys.emplace_back(key, of_joint->text(key));
  }
  return changes;
}

void read_model(Mapping& in, Scenario& s, const fs::path& folder, YAML::Node root, const mujoco::Options& options) {
  const fs::path file = resolve_file(folder, in, root, "model");
  const std::vector<DriveChange> changes = drive_changes(in);
  auto model = load_with_drives(file, changes, options);
  // Of a model that loads as it is, the changes are what is wrong.
  if (!model && !changes.empty() && mujoco::load_file(file, options)) in.fail("drives", model.error().message);
  s.model = or_wrong_input(std::move(model));
}

void read_start(Mapping& in, Scenario& s) {
  const auto& model = *s.model;
  s.start_rad.assign(model.drives().size(), 0.0);
  if (in.has("keyframe")) {
    const std::string key = in.text("keyframe");
    const int id = mj_name2id(model.get(), mjOBJ_KEY, key.c_str());
    if (id < 0) in.fail("keyframe", fmt::format("the model has no keyframe '{}'", key));
    for (std::size_t j = 0; j < s.start_rad.size(); ++j)
      s.start_rad[j] = model->key_qpos[id * model->nq + position_address(model.get(), model.drives()[j])];
  }
  s.start_rad = per_drive(in, "start_rad", model, s.start_rad, positions);

  if (in.has("ambient_degC")) s.ambient_degC = in.number("ambient_degC", {-100, 300});
  s.temperature_degC.clear();
  for (const auto& drive : model.drives())
    s.temperature_degC.push_back(s.ambient_degC.value_or(drive.drive.thermal.T_amb_degC));
}

/// The motion, or the start pose without one, stays within the joints' ranges.
void check_reach(const Mapping& in, const Scenario& s) {
  const auto& model = *s.model;
  for (std::size_t j = 0; j < s.start_rad.size(); ++j) {
    const auto& drive = model.drives()[j];
    if (!model->jnt_limited[drive.joint]) continue;
    const double low = model->jnt_range[2 * drive.joint], high = model->jnt_range[2 * drive.joint + 1];
    const auto [min, max] = s.motion ? s.motion->reach_rad(j) : std::pair{s.start_rad[j], s.start_rad[j]};
    if (!(min >= low - 1e-9 && max <= high + 1e-9))
      in.fail(s.motion ? "motion" : "start_rad",
              fmt::format("takes {} to {:.4g} .. {:.4g} rad, but its range is {:.4g} .. {:.4g} rad",
                          joint_name(model.get(), drive), min, max, low, high));
  }
}

void check_duration(const Mapping& in, const Scenario& s) {
  const double timestep_s = (*s.model)->opt.timestep;
  if (s.duration_s == 0) in.fail("duration_s", "is missing");
  if (!(s.duration_s >= timestep_s && s.duration_s <= longest_s))
    in.fail("duration_s", fmt::format("is {:g} s but must be within a time step, {:g} s, and {:g} s", s.duration_s,
                                      timestep_s, longest_s));
  if (s.motion && s.motion->period_s() > longest_s)
    in.fail("motion", fmt::format("takes {:.3g} s a cycle, at most {:g} s are possible; move faster or less far",
                                  s.motion->period_s(), longest_s));
}

void read_temperatures(Mapping& in, Scenario& s) {
  if (s.recording && s.recording->temperature_degC.size() == 1 && std::isfinite(s.recording->temperature_degC[0][0]))
    s.temperature_degC[0] = s.recording->temperature_degC[0][0];
  s.temperature_degC = per_drive(in, "temperature_degC", *s.model, s.temperature_degC, {-100, 300});
}

Wave read_wave(Mapping& in, int control, double timestep_s) {
  Wave wave{.control = control,
            .offset = in.number_or("offset", 0, {-1e9, 1e9}),
            .amplitude = in.number_or("amplitude", 0, {-1e9, 1e9}),
            .frequency_hz = in.number_or("frequency_hz", 0, {0, 1e6}),
            .phase_rad = in.number_or("phase_rad", 0, {-1e6, 1e6})};
  if (const double steps = 1 / (wave.frequency_hz * timestep_s); std::isfinite(steps) && steps > max_period_steps)
    in.fail("frequency_hz", fmt::format("is {} but must be 0 or at least {:.2g}: a period may have {:g} time steps",
                                        wave.frequency_hz, 1 / (max_period_steps * timestep_s), max_period_steps));
  in.done();
  return wave;
}

/// Waves of the actuators beside drives and transmissions.
void read_actuators(Mapping& in, Scenario& s) {
  auto actuators = in.mapping("actuators");
  if (!actuators) return;
  const auto& model = *s.model;
  std::vector<std::string> names;
  std::vector<int> controls;
  for (int a = 0; a < model->nu; ++a)
    if (std::ranges::none_of(model.drives(), [a](const auto& drive) { return drive.actuator == a; }) &&
        std::ranges::none_of(model.springs(), [a](const auto& spring) { return spring.actuator == a; })) {
      names.emplace_back(model->names + model->name_actuatoradr[a]);
      controls.push_back(mujoco::engine::control_address(model.get(), a));
    }
  const std::vector<std::string_view> accepted(names.begin(), names.end());
  for (const auto& name : actuators->names()) {
    const auto found = std::ranges::find(names, name);
    if (found == names.end())
      actuators->fail(name, names.empty()
                                ? "is no actuator of the model beside its drives; it has none"
                                : fmt::format("is no actuator of the model beside its drives; did you mean '{}'?",
                                              nearest(name, accepted)));
    auto wave = actuators->mapping(name);
    if (!wave) actuators->fail(name, "must be a mapping: offset, amplitude, frequency_hz, phase_rad");
    s.waves.push_back(read_wave(*wave, controls[static_cast<std::size_t>(found - names.begin())], model->opt.timestep));
  }
}

void read_multirate(Mapping& in, Scenario& s) {
  auto multirate = in.mapping("multirate");
  if (!multirate) return;
  s.multirate.enabled = multirate->flag_or("enabled", true);
  s.multirate.tolerance_K = multirate->number_or("tolerance_K", s.multirate.tolerance_K, {1e-6, 1000});
  multirate->done();
  if (s.multirate.enabled && (!s.motion || s.motion->period_s() == 0))
    in.fail("multirate", "needs a motion that repeats (cycle or back_and_forth)");
  const auto heats = [](const mujoco::Binding& b) { return b.drive.winding.present(); };
  if (s.multirate.enabled && std::ranges::any_of(s.model->drives(), heats))
    in.fail("multirate", "does not know the heat of windings; remove it, or the keys of the winding");
}

void read_expects(Mapping& in, Scenario& s) {
  if (!in.has("expects")) return;
  s.expects = in.texts("expects");
  std::vector<std::string_view> names;
  for (const HealthCheck& check : health_checks()) names.push_back(check.name);
  for (const auto& expected : s.expects)
    if (std::ranges::find(names, expected) == names.end())
      in.fail("expects",
              fmt::format("'{}' is no health check; did you mean '{}'?", expected, nearest(expected, names)));
}

void read_events(Mapping& in, Scenario& s) {
  for (const Mapping& event : in.mappings("events")) s.events.push_back(read_event(event, *s.model, s.duration_s));
  std::ranges::stable_sort(s.events, {}, &Event::time_s);
}

void read_baseline(Mapping& in, Scenario& s, const fs::path& folder, YAML::Node root, const mujoco::Options& options) {
  auto baseline = in.mapping("baseline");
  if (!baseline) return;
  s.baseline = or_wrong_input(mujoco::load_file(resolve_file(folder, *baseline, root["baseline"], "model"), options));
  s.baseline_control = dc_position_options(*baseline, s)[0];
  s.baseline_delay_s = baseline->number_or("delay_s", 0, {0, 10});
  baseline->done();
  if (!s.recording || s.recording->measured_rad.empty() ||
      !std::ranges::all_of(s.recording->measured_rad[0], [](double q) { return std::isfinite(q); }))
    in.fail("baseline", "needs a recording with measured positions in all entries");
  if (s.recording->position_rad.empty()) in.fail("baseline", "follows positions, but the recording commands none");
  if ((*s.baseline)->nu != 1 || (*s.baseline)->nq != 1)
    in.fail("baseline", "its model must have one joint and one motor");
}

/// Sections are read in the order in which they need each other. Throws InputError.
Scenario read_scenario(const fs::path& file, const std::vector<std::string>& settings) {
  YAML::Node root = load_yaml(file);
  for (const auto& setting : settings) apply_setting(root, setting, "--set duration_s=60");
  if (root.IsMap()) root.remove("vary");
  const fs::path folder = fs::absolute(file).parent_path();

  Scenario s;
  s.file = file;
  Mapping in(file.string(), "", root);
  in.accept({std::begin(keys), std::end(keys)});
  s.name = in.file_name_or("name", file.stem().string());
  root["name"] = s.name;
  s.description = in.text_or("description", "");
  for (const char* key : {"robot", "serial_number"}) (void)in.text_or(key, "");  // for people: pages show them
  s.seed = in.whole_or("seed", 1, {0, 9007199254740992.0});
  const mujoco::Options options = engine_options(in);
  read_model(in, s, folder, root, options);
  if (s.model->drives().empty())
    in.fail("model", fmt::format("{0} has no tribotwin.drive; make one: tribotwin add-drives {0} -o OUT.xml",
                                 root["model"].Scalar()));
  for (const mujoco::Binding& b : s.model->drives())
    if (b.drive.control != drive::Control::torque)
      in.fail("model", fmt::format("drive '{}' has control=\"position\", but the controller of a scenario commands "
                                   "motor torques; use control=\"torque\"",
                                   b.drive.name));
  s.duration_s = in.number_or("duration_s", 0, {mujoco::shortest_timestep_s, longest_s});
  s.telemetry_rate_hz = in.number_or("telemetry_rate_hz", 100, {1e-6, 1e6});

  read_start(in, s);
  if (auto motion = in.mapping("motion")) read_motion(*motion, s, folder, root["motion"]);
  check_reach(in, s);
  check_duration(in, s);
  read_temperatures(in, s);
  read_control(in, s);
  read_actuators(in, s);
  read_multirate(in, s);
  read_events(in, s);
  read_expects(in, s);
  read_baseline(in, s, folder, root, options);
  in.done();
  s.resolved_yaml = to_text(root);
  return s;
}

/// How fast a joint of `motion.speed_rad_s.JOINT=60` moves now, for a message.
std::string pace_of(const Scenario& s, std::string_view key) {
  constexpr std::string_view speeds = "motion.speed_rad_s.";
  if (!key.starts_with(speeds)) return {};
  const auto drive = find_drive(*s.model, key.substr(speeds.size()));
  if (!drive) return {};
  double fastest = 0;
  for (const Motion::Pace& pace : s.motion->paces(*drive)) fastest = std::max(fastest, pace.speed_rad_s);
  return fmt::format(" ({} moves at up to {:.4g})", key.substr(speeds.size()), fastest);
}

/// Speeds and accelerations are limits, and the slowest joint sets the pace of all: one that has no effect is said, for
/// a user who sets it wants one.
void check_settings(const Scenario& s, const fs::path& file, const std::vector<std::string>& settings) {
  constexpr std::string_view limits[] = {"motion.speed_", "motion.ramp_s", "motion.acceleration_"};
  for (std::size_t i = 0; i < settings.size(); ++i) {
    const std::string& setting = settings[i];
    if (std::ranges::none_of(limits, [&](std::string_view limit) { return setting.starts_with(limit); })) continue;
    std::vector<std::string> others = settings;
    others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
    const auto without = [&]() -> std::optional<Scenario> {
      try {
        return read_scenario(file, others);
      } catch (const InputError&) {
        return {};  // it is needed
      }
    }();
    if (!without || !s.motion || without->resolved_yaml == s.resolved_yaml || without->motion != s.motion) continue;
    throw InputError(fmt::format(
        "{}: --set {}: changes nothing: it is a limit, and others of the motion's limits set the pace of all joints{}; "
        "change those as well, or leave it out",
        file.string(), setting, pace_of(s, setting.substr(0, setting.find('=')))));
  }
}

}  // namespace

fs::path resolve_file(const fs::path& folder, Mapping& mapping, YAML::Node node, const std::string& key) {
  const fs::path path = mapping.file(key, folder);
  node[key] = fs::absolute(path).string();
  return path;
}

std::vector<double> per_drive(Mapping& in, const std::string& key, const mujoco::Model& model,
                              std::vector<double> values, Bounds bounds) {
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

double Wave::operator()(double t) const {
  return offset + amplitude * std::sin(2 * std::numbers::pi * frequency_hz * t + phase_rad);
}

Result<Scenario> load_scenario(const fs::path& file, const std::vector<std::string>& settings) {
  try {
    Scenario scenario = read_scenario(file, settings);
    check_settings(scenario, file, settings);
    return scenario;
  } catch (const InputError& e) {
    return tl::unexpected(e.what());
  }
}

}  // namespace tribotwin::twin
