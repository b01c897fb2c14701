#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/simulation/scenario_input.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;

struct MotionInput {
  Mapping& in;
  Scenario& scenario;
  const fs::path& folder;
  YAML::Node node;

  const mujoco::Model& model() const { return *scenario.model; }
  std::size_t drives() const { return model().drives().size(); }
  double dwell_s() const { return in.number_or("dwell_s", 0.2, {0, 1e6}); }
};

Motion read_hold(const MotionInput& input) {
  input.in.done();
  return Motion(input.scenario.start_rad);
}

/// The drive of each joint of a recording.
std::vector<std::size_t> drives_of(const MotionInput& input, const SetPoints& points) {
  std::vector<std::size_t> drives;
  for (const auto& joint : points.joints) drives.push_back(drive_index(input.model(), input.in, "file", joint));
  if (!points.joints.empty()) return drives;
  if (input.drives() != 1)
    input.in.fail("file", fmt::format("is a recording of one joint, but the model has {} drives", input.drives()));
  return {0};
}

/// The file, or the record in the folder of a run.
fs::path recording_file(const MotionInput& input) {
  const fs::path given = (input.folder / input.in.text("file")).lexically_normal();
  const auto record = record_of(given);
  if (!record || *record == given) return resolve_file(input.folder, input.in, input.node, "file");
  YAML::Node node = input.node;  // nodes are references
  node["file"] = fs::absolute(*record).string();
  return *record;
}

Motion read_recording(const MotionInput& input) {
  Scenario& s = input.scenario;
  const auto file = recording_file(input);
  TableOptions tables;
  if (input.in.has("columns")) tables.columns = resolve_file(input.folder, input.in, input.node, "columns");
  if (input.in.has("topic")) tables.topic = input.in.text("topic");
  auto points = or_wrong_input(read_set_points(file, tables));
  const double delay_s = input.in.number_or("delay_s", 0, {0, 10});
  input.in.done();
  const auto drives = drives_of(input, points);
  for (std::size_t k = 0; k < drives.size(); ++k)
    if (!points.measured_rad.empty() && std::isfinite(points.measured_rad[k][0]))
      s.start_rad[drives[k]] = points.measured_rad[k][0];
    else if (!points.position_rad.empty())
      s.start_rad[drives[k]] = points.position_rad[k][0];
  Motion motion = motion_of(points, drives, s.start_rad, delay_s);
  if (s.duration_s == 0) s.duration_s = points.time_s.back() - points.time_s[0];
  if (s.duration_s == 0)
    input.in.fail("file", "is a recording of a single instant, which lasts no time; give duration_s");
  s.recording = std::move(points);
  return motion;
}

Motion read_cycle(const MotionInput& input) {
  Mapping& in = input.in;
  Scenario& s = input.scenario;
  const double dwell_s = input.dwell_s(), share = in.number_or("speed_share", 0.8, {1e-6, 1});
  std::vector<double> speed;
  for (std::size_t j = 0; j < input.drives(); ++j)
    speed.push_back(share * joint_speed_max_rad_s(input.model(), j).value_or(1));
  speed = per_drive(in, "speed_rad_s", input.model(), speed, {1e-9, 1e6});
  std::vector<double> acceleration(speed.size());
  for (std::size_t j = 0; j < speed.size(); ++j) acceleration[j] = speed[j] / in.number_or("ramp_s", 0.4, {1e-3, 1e3});
  const auto points = in.mappings("waypoints");
  const bool repeat = in.flag_or("repeat", true);
  in.done();
  if (points.size() < 2) in.fail("waypoints", "needs at least two poses, each a mapping with position_rad");
  std::vector<std::vector<double>> poses;
  for (Mapping point : points) {
    poses.push_back(
        per_drive(point, "position_rad", input.model(), poses.empty() ? s.start_rad : poses.back(), positions));
    point.done();
  }
  s.start_rad = poses.front();
  Motion motion(poses.front());
  for (std::size_t i = 1; i < poses.size(); ++i) motion.move_to(poses[i], speed, acceleration).dwell(dwell_s);
  if (repeat) motion.move_to(poses.front(), speed, acceleration).dwell(dwell_s).repeat(input.model()->opt.timestep);
  return motion;
}

Motion read_back_and_forth(const MotionInput& input) {
  Mapping& in = input.in;
  Scenario& s = input.scenario;
  const double dwell_s = input.dwell_s();
  const std::size_t joint = drive_index(input.model(), in, "joint", in.text("joint"));
  const double travel = in.number("travel_rad", {1e-9, 1e4}), speed = in.number("speed_rad_s", {1e-9, 1e4});
  const double acceleration = in.number_or("acceleration_rad_s2", 10, {1e-6, 1e6});
  const bool repeat = in.flag_or("repeat", true);
  in.done();
  Motion motion = back_and_forth(s.start_rad, joint, travel, speed, acceleration, dwell_s);
  s.start_rad.assign(motion.start_rad().begin(), motion.start_rad().end());
  if (repeat) motion.repeat(input.model()->opt.timestep);
  return motion;
}

Motion read_test_cycle(const MotionInput& input) {
  Mapping& in = input.in;
  Scenario& s = input.scenario;
  const double dwell_s = input.dwell_s();
  std::vector<std::size_t> joints;
  const YAML::Node list = in.raw("joints");
  if (!list || !list.IsSequence() || list.size() == 0) in.fail("joints", "must be a list of joint names");
  for (const auto& name : list) joints.push_back(drive_index(input.model(), in, "joints", name.Scalar()));
  const double acceleration = in.number_or("acceleration_rad_s2", 400 * (std::numbers::pi / 180), {1e-6, 1e6});
  in.done();
  Motion motion = test_cycle(s.start_rad, joints, acceleration, dwell_s);
  if (s.duration_s == 0) s.duration_s = motion.duration_s();
  return motion;
}

/// One row per type of motion.
constexpr std::pair<std::string_view, Motion (*)(const MotionInput&)> motion_types[] = {
    {"hold", read_hold},
    {"cycle", read_cycle},
    {"back_and_forth", read_back_and_forth},
    {"test_cycle", read_test_cycle},
    {"recording", read_recording},
};

}  // namespace

void read_motion(Mapping in, Scenario& scenario, const fs::path& folder, YAML::Node node) {
  const auto read = choice_of(in, "type", motion_types);
  scenario.motion = read({in, scenario, folder, node});
}

}  // namespace tribotwin::twin
