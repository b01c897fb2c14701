#include <algorithm>
#include <cmath>
#include <iterator>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/commands/robot.hpp>
#include <tribotwin/twin/gears/effort.hpp>
#include <tribotwin/twin/identification/rigid_body/model_agreement.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/output.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/coupling/coupling.hpp>
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

Robot coupled_robot(const std::string& model, const std::vector<std::string>& coupling, bool quiet) {
  Robot robot = load_robot(model);
  if (coupling == std::vector<std::string>{"none"}) return robot;
  std::vector<CoupledMotor> motors;
  if (coupling.empty()) {
    motors = motors_on_tendons(robot.regressor);
    if (!quiet)
      for (const CoupledMotor& motor : motors)
        note("{}: motor {} turns with {}, as its tendon says; {}", model, motor.name, sum_of(motor, robot.regressor),
             "--coupling none leaves that out");
    return motors.empty() ? robot : with_motors(robot, std::move(motors), model);
  }
  for (const std::string& text : coupling)
    motors.push_back(or_wrong_input(coupled_motor("--coupling", text, robot.regressor)));
  return with_motors(robot, std::move(motors), "--coupling");
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
                  "sampling rate, of the slowest file)")
      ->check(CLI::Range(1e-3, 1e6));
  command
      .add_option("--decimate", preparation.decimation,
                  "Use one of so many samples (default: five per period of the cut-off)")
      ->check(CLI::Range(1u, 1000000u));
}

std::vector<double> given_lags(const std::vector<std::string>& values, const Regressor& regressor) {
  std::vector<double> out;
  for (const std::string& text : values) {
    const auto lag = to_number(text);
    if (!lag || !(std::abs(*lag) <= largest_lag_s))
      throw InputError(
          fmt::format("--lag {}: give seconds of -{:g} .. {:g}, such as 0.003", text, largest_lag_s, largest_lag_s));
    out.push_back(*lag);
  }
  const auto joints = static_cast<std::size_t>(regressor.joints());
  if (out.size() == 1) out.resize(joints, out.front());
  if (out.size() != joints)
    throw InputError(fmt::format("--lag: {} numbers; give one, or one for each of the {} joints", out.size(), joints));
  return out;
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

/// With the gear ratios of the model where no others are given.
TableOptions options_of(const Robot& robot, const TableArguments& tables) {
  TableOptions options = or_wrong_input(tables.options());
  for (const auto& drive : robot.model->drives())
    options.gear_ratio.add_default(joint_name(robot.model->get(), drive), drive.drive.gear_ratio);
  return options;
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

std::vector<std::optional<double>> torque_per_ampere(const Robot& robot, const TableArguments& tables) {
  const TableOptions options = options_of(robot, tables);
  std::vector<std::optional<double>> out;
  for (Eigen::Index j = 0; j < robot.regressor.joints(); ++j) {
    const std::string& joint = robot.regressor.joint_name(j);
    const auto constant = options.torque_constant.find(joint), gear = options.gear_ratio.find(joint);
    if (constant && !gear)
      throw InputError(fmt::format(
          "--torque-constant: torque at the arm is torque constant x gear ratio x current: --gear-ratio {}=N "
          "is needed (1 where the constant is that of the arm side)",
          joint));
    out.push_back(constant ? std::optional(*constant * *gear) : std::nullopt);
  }
  return out;
}

std::vector<RobotRecording> read_recordings(const Robot& robot, const std::vector<std::string>& files,
                                            const TableArguments& tables, bool quiet,
                                            std::span<const double> nm_per_a) {
  refuse_twice(files);
  TableOptions options = options_of(robot, tables);
  if (!quiet) note_guessed_ratios(*robot.model, or_wrong_input(tables.options()));
  if (!nm_per_a.empty()) options.torque_constant = {};
  std::vector<RobotRecording> recordings;
  for (const auto& file : files) {
    auto recording = read_robot_recording(file, robot.regressor, options, nm_per_a);
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

std::vector<RobotRecording> read_recordings(const Robot& robot, const std::vector<std::string>& files,
                                            const TableArguments& tables, bool quiet,
                                            std::span<const Estimate> drive_gains) {
  std::vector<double> nm_per_a;
  for (const Estimate& e : drive_gains) nm_per_a.push_back(e.unit.ends_with("/A") ? e.value : 0);
  if (!tables.torque_constant.empty()) nm_per_a.clear();
  auto recordings = read_recordings(robot, files, tables, quiet, nm_per_a);
  for (RobotRecording& rec : recordings)
    for (std::size_t j = 0; j < drive_gains.size(); ++j) {
      if (rec.of_current[j] && drive_gains[j].unit == "1")
        throw InputError(fmt::format(
            "{}: has a current of {}, whose drive gain is the factor of a torque column: give that column, or "
            "--torque-constant",
            rec.file.string(), drive_gains[j].name));
      if (rec.of_current[j] && nm_per_a[j] == 0) rec.without_torque[j] = true;  // its drive gain is not known
      if (!rec.of_current[j] && drive_gains[j].unit == "1")
        rec.torque.row(static_cast<Eigen::Index>(j)) *= drive_gains[j].value;
    }
  return recordings;
}

void add_payload(CLI::App& command, std::vector<std::string>& payloads) {
  command
      .add_option("--payload", payloads,
                  "FILE=\"3.2 kg [+- 0.05] [at X Y Z [+- S]] [inertia XX YY ZZ] [on SITE]\": what the robot carries in "
                  "that recording beside the model's bodies: mass, centre of mass [m] from the site (flange), inertia "
                  "about it [kg m^2]; may be repeated")
      ->allow_extra_args(false);
}

std::vector<KnownPayload> known_payloads(const std::vector<std::string>& texts, const std::vector<std::string>& files) {
  std::vector<KnownPayload> out;
  for (const std::string& text : texts) {
    KnownPayload payload = or_wrong_input(known_payload(text));
    if (std::ranges::find(files, payload.file) == files.end())
      throw InputError(fmt::format("--payload '{}': '{}' is none of the recordings, {}", text, payload.file,
                                   joined(std::span<const std::string>(files))));
    if (std::ranges::find(out, payload.file, &KnownPayload::file) != out.end())
      throw InputError(fmt::format("--payload '{}': {} has a payload already", text, payload.file));
    out.push_back(std::move(payload));
  }
  return out;
}

void carry(const Robot& robot, std::span<const KnownPayload> payloads, std::vector<RobotRecording>& recordings,
           bool quiet) {
  for (const KnownPayload& payload : payloads) {
    if (!payload.centre_m)
      throw InputError(
          fmt::format("--payload {}=\"{}\": its centre of mass is needed, 'at X Y Z'", payload.file, payload.text));
    if (!payload.inertia_kg_m2 && !quiet)
      note("--payload {}: no inertia is given, it counts as a point of mass", payload.file);
    const auto found = std::ranges::find(recordings, payload.file, [](const auto& r) { return r.file.string(); });
    found->carried = or_wrong_input(placed(payload, robot.regressor)).body;
  }
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
