#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/identification/drive_gains/payload.hpp>
#include <tribotwin/twin/identification/estimates.hpp>
#include <tribotwin/twin/identification/rigid_body/joint_motion.hpp>
#include <tribotwin/twin/io/command_line/command_line.hpp>
#include <tribotwin/twin/io/tables/table_options.hpp>
#include <tribotwin/twin/robot/base_parameters.hpp>

/// The part that the commands on a whole robot's dynamics share.
namespace tribotwin::twin::program {

struct Robot {
  std::shared_ptr<const mujoco::Model> model;
  Regressor regressor;
  BaseParameters base;
};

/// Throws InputError where the model cannot be loaded or is no rigid tree of hinges and slides.
Robot load_robot(const std::string& file);

/// The same with these coupled motors, which come from `where`, an option or a file. Throws InputError where they do
/// not determine the joints.
Robot with_motors(const Robot& robot, std::vector<CoupledMotor> motors, const std::string& where);

/// The robot of a model with the coupled motors that the option --coupling, or else the model's tendons, say. Throws
/// InputError as load_robot and with_motors.
Robot coupled_robot(const std::string& model, const std::vector<std::string>& coupling, bool quiet);

/// A note that the law of a drive is a guess, where it has the starting points of a gear class.
void note_starting_point(const mujoco::Model& model, const mujoco::Binding& drive);

/// Options of how recordings are prepared.
void add_preparation(CLI::App& command, identification::Preparation& preparation);

/// Seconds per joint of --lag, one number for all or one each. Throws InputError.
std::vector<double> given_lags(const std::vector<std::string>& values, const Regressor& regressor);

/// The torque at the arm per ampere [Nm/A; N/A] that options and gear ratios of the model say, per joint; nothing where
/// they do not. Throws InputError.
std::vector<std::optional<double>> torque_per_ampere(const Robot& robot, const TableArguments& tables);

/// Reads recordings, with the gear ratios of the model where no others are given. Throws InputError. `nm_per_a`: as for
/// read_robot_recording, in place of --torque-constant.
std::vector<identification::RobotRecording> read_recordings(const Robot& robot, const std::vector<std::string>& files,
                                                            const TableArguments& tables, bool quiet,
                                                            std::span<const double> nm_per_a = {});

/// The same with the drive gains of a fit (DynamicsFile::drive_gains), which make torques of currents, unless
/// --torque-constant does, or correct those of torque columns.
std::vector<identification::RobotRecording> read_recordings(const Robot& robot, const std::vector<std::string>& files,
                                                            const TableArguments& tables, bool quiet,
                                                            std::span<const identification::Estimate> drive_gains);

/// Adds --payload.
void add_payload(CLI::App& command, std::vector<std::string>& payloads);

/// The payloads that options say, of these files. Throws InputError.
std::vector<identification::KnownPayload> known_payloads(const std::vector<std::string>& texts,
                                                         const std::vector<std::string>& files);

/// Lets the robot carry payloads that are known but for their inertia, which counts as that of a point. Throws
/// InputError where the centre of mass of one is not given.
void carry(const Robot& robot, std::span<const identification::KnownPayload> payloads,
           std::vector<identification::RobotRecording>& recordings, bool quiet);

/// Prepares recordings; prints notes on them, sizes that the model's actuators contradict among these, unless `quiet`.
/// Throws InputError.
identification::JointMotion prepared(const Robot& robot, const std::vector<identification::RobotRecording>& recordings,
                                     const identification::Preparation& preparation, bool quiet);

/// Both.
identification::JointMotion read_motion(const Robot& robot, const std::vector<std::string>& files,
                                        const identification::Preparation& preparation, const TableArguments& tables,
                                        bool quiet);

}  // namespace tribotwin::twin::program
