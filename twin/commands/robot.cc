#include <algorithm>
#include <iterator>

#include <fmt/format.h>

#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/commands/robot.hpp>
#include <tribotwin/twin/gears/effort.hpp>
#include <tribotwin/twin/identification/rigid_body/model_agreement.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/output.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/starting_points.hpp>

namespace tribotwin::twin::program {

using namespace identification;

Robot load_robot(const std::string& file) {
  const auto model = mujoco::load_file(given_or_shipped(file, ".xml"));
  if (!model) throw InputError(model.error().message);
  if (!(*model)->springs().empty())
    throw InputError(
        fmt::format("{}: has an elastic transmission; rigid dynamics do not describe what is behind it", file));
  const auto regressor = Regressor::create((*model)->get());
  if (!regressor) throw InputError(fmt::format("{}: {}", file, regressor.error().message));
  return {*model, *regressor, base_parameters(*regressor)};
}

Robot with_motors(const Robot& robot, std::vector<CoupledMotor> motors, const std::string& where) {
  const auto regressor = Regressor::create(robot.model->get(), std::move(motors));
  if (!regressor) throw InputError(fmt::format("{}: {}", where, regressor.error().message));
  return {robot.model, *regressor, base_parameters(*regressor)};
}

void note_starting_point(const mujoco::Model& model, const mujoco::Binding& drive) {
  if (const std::string_view from = starting_point(model, drive); !from.empty())
    note(
        "the law of {} is a guess, the starting points of a gear class ({}): this is friction of the class, not of "
        "your "
        "robot",
        joint_name(model.get(), drive), from);
}

void add_preparation(CLI::App& command, Preparation& preparation) {
  command
      .add_option("--cutoff", preparation.cutoff_hz,
                  "Cut-off of the zero-phase low-pass on positions and torques [Hz] (default: 20, or a fifth of the "
                  "sampling rate)")
      ->check(CLI::Range(1e-3, 1e6));
  command
      .add_option("--decimate", preparation.decimation,
                  "Use one of so many samples (default: five per period of the cut-off)")
      ->check(CLI::Range(1u, 1000000u));
}

namespace {

/// Torque from current is proportional to the gear ratio, which may be that of a gear class. `options` are the user's.
void note_guessed_ratios(const mujoco::Model& model, const TableOptions& options) {
  for (const auto& drive : model.drives()) {
    const std::string joint = joint_name(model.get(), drive);
    const std::string_view from = starting_point(model, drive);
    if (!from.empty() && !options.gear_ratio.find(joint) && options.torque_constant.find(joint))
      note(
          "{}: --torque-constant uses gear ratio {:g}, which is a guess, that of gear class {}; give yours: "
          "--gear-ratio {}=N",
          joint, drive.drive.gear_ratio, from, joint);
  }
}

/// What the actuators of the joints can give [Nm; N]; 0 where the model does not say.
std::vector<double> efforts_of(const Robot& robot) {
  const mjModel* m = robot.model->get();
  std::vector<double> all;
  for (int joint = 0; joint < m->njnt; ++joint) {
    const auto effort = actuator_effort(m, joint);
    all.push_back(effort ? effort->largest_nm() : 0);
  }
  for (const auto& drive : robot.model->drives())
    if (m->actuator_ctrllimited[drive.control])
      all[static_cast<std::size_t>(drive.dof)] = m->actuator_ctrlrange[2 * drive.control + 1] * drive.gear;
  return all;
}

}  // namespace

std::vector<RobotRecording> read_recordings(const Robot& robot, const std::vector<std::string>& files,
                                            const TableArguments& tables, bool quiet) {
  refuse_twice(files);
  TableOptions options = or_wrong_input(tables.options());
  if (!quiet) note_guessed_ratios(*robot.model, options);
  for (const auto& drive : robot.model->drives())
    options.gear_ratio.add_default(joint_name(robot.model->get(), drive), drive.drive.gear_ratio);
  std::vector<RobotRecording> recordings;
  for (const auto& file : files) {
    auto recording = read_robot_recording(file, robot.regressor, options);
    if (!recording) throw InputError(recording.error().message);
    for (const auto& other : recordings)
      if (same_recording(other, *recording))
        throw InputError(
            fmt::format("{} and {} are the same recording; one that counts twice makes sigmas too small: give it once",
                        other.file.string(), file));
    recordings.push_back(std::move(*recording));
  }
  return recordings;
}

JointMotion prepared(const Robot& robot, const std::vector<RobotRecording>& recordings, const Preparation& preparation,
                     bool quiet) {
  auto motion = prepare(recordings, robot.regressor, preparation);
  if (!motion) throw InputError(motion.error().message);
  std::ranges::move(doubtful_sizes(robot.regressor, *motion, efforts_of(robot)), std::back_inserter(motion->notes));
  if (!quiet)
    for (const auto& text : motion->notes) note("{}", text);
  return std::move(*motion);
}

JointMotion read_motion(const Robot& robot, const std::vector<std::string>& files, const Preparation& preparation,
                        const TableArguments& tables, bool quiet) {
  return prepared(robot, read_recordings(robot, files, tables, quiet), preparation, quiet);
}

}  // namespace tribotwin::twin::program
