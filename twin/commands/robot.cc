#include <fmt/format.h>

#include <tribotwin/twin/commands/robot.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/output.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/robot/arm.hpp>

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

std::vector<RobotRecording> read_recordings(const Robot& robot, const std::vector<std::string>& files,
                                            const TableArguments& tables) {
  TableOptions options = or_wrong_input(tables.options());
  for (const auto& drive : robot.model->drives())
    options.gear_ratio.add_default(joint_name(robot.model->get(), drive), drive.drive.gear_ratio);
  std::vector<RobotRecording> recordings;
  for (const auto& file : files) {
    auto recording = read_robot_recording(file, robot.regressor, options);
    if (!recording) throw InputError(recording.error().message);
    recordings.push_back(std::move(*recording));
  }
  return recordings;
}

JointMotion read_motion(const Robot& robot, const std::vector<std::string>& files, const Preparation& preparation,
                        const TableArguments& tables, bool quiet) {
  const auto recordings = read_recordings(robot, files, tables);
  auto motion = prepare(recordings, robot.regressor, preparation);
  if (!motion) throw InputError(motion.error().message);
  if (!quiet)
    for (const auto& text : motion->notes) note("{}", text);
  return std::move(*motion);
}

}  // namespace tribotwin::twin::program
