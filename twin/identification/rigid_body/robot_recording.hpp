#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/tables/table_options.hpp>
#include <tribotwin/twin/robot/regressor.hpp>

/// Recordings of all joints by a robot's controller.
namespace tribotwin::twin::identification {

/// A payload: what a recorded robot carries beside the bodies of its model.
struct CarriedBody {
  int body = -1;               ///< of mjModel, to which it is fixed
  Eigen::VectorXd parameters;  ///< the ten of the regressor, about the origin of that body's frame and in its axes
};

/// Matrices are joints x samples, in the order of the regressor's joints.
struct RobotRecording {
  std::filesystem::path file;
  std::vector<double> time_s;
  Eigen::MatrixXd position;          ///< rad; m
  Eigen::MatrixXd torque;            ///< of the motor, arm side, positive drives forward: Nm; N
  std::vector<bool> without_torque;  ///< joints whose torque is not in the file, 0 in `torque`; empty: none
  Eigen::MatrixXd temperature_degC;  ///< empty where the file has none
  Eigen::MatrixXd velocity;          ///< rad/s; m/s; empty where not every joint has one
  std::vector<bool> of_current;      ///< joints whose `torque` was made of a current; empty: none
  std::optional<CarriedBody> carried;
  std::vector<std::string> notes;
};

/// Torques are those of the joints, or, with a column torque_MOTOR_nm for every coupled motor of the regressor in place
/// of its joint's, those of the motors, each behind its gear.
///
/// Reads `time_s, position_JOINT_rad|_m, torque_JOINT_nm|_n [, velocity_JOINT_rad_s|_m_s, temperature_JOINT_degC]` for
/// every joint of the model, from any kind of table (read_numbers); some joints may be without torque, as their motion
/// acts on the others. ErrorKind::input with file, column and what would
/// be right; also where values do not fit their header: positions beyond the joint's range or too fast (degrees,
/// swapped columns), a velocity that is not the slope of the position, time that does not increase, a robot at rest.
/// `nm_per_a`: per joint, the torque at the arm per ampere [Nm/A; N/A]: a joint without a torque column has this times
/// its current_JOINT_a, where there is one; empty: currents are not read.
Result<RobotRecording> read_robot_recording(const std::filesystem::path& file, const Regressor& regressor,
                                            const TableOptions& options = {}, std::span<const double> nm_per_a = {});

/// Whether both are one recording, whatever their files look like: the same steps of time, positions and torques but
/// for rounding. Two recordings of one motion differ in their noise.
bool same_recording(const RobotRecording& a, const RobotRecording& b);

}  // namespace tribotwin::twin::identification
