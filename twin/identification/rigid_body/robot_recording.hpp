#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/robot/regressor.hpp>

/// What a robot's controller recorded of all joints, made ready for the dynamics.
namespace tribotwin::twin::identification {

/// Matrices are joints x samples, in the order of the regressor's joints.
struct RobotRecording {
  std::filesystem::path file;
  std::vector<double> time_s;
  Eigen::MatrixXd position;          ///< rad; m
  Eigen::MatrixXd torque;            ///< of the motor, arm side, positive drives forward: Nm; N
  Eigen::MatrixXd temperature_degC;  ///< no samples where the file has none
  std::vector<std::string> notes;
};

/// Reads `time_s, position_JOINT_rad|_m, torque_JOINT_nm|_n [, velocity_JOINT_rad_s|_m_s, temperature_JOINT_degC]` for
/// every joint of the model. Fails with file, column and what would be right; also where the numbers cannot be what
/// their header says: beyond the joint's range or faster than any robot (degrees, swapped columns), a velocity that is
/// not the slope of the position, time that does not increase, a robot that stands.
Result<RobotRecording> read_robot_recording(const std::filesystem::path& file, const Regressor& regressor);

struct Preparation {
  double cutoff_hz = 0;  ///< of the zero-phase low-pass on positions and torques; 0: 20 Hz, or a fifth of the sampling
                         ///< rate where that is less
  unsigned decimation = 0;  ///< every how many samples one is kept; 0: five per period of the cut-off
};

/// Equidistant samples of motion, filtered, at rest of no matter to the fit. joints x samples.
struct JointMotion {
  Eigen::MatrixXd q, qd, qdd, torque, temperature_degC;  ///< temperature: 20 where none was recorded
  Eigen::Matrix<bool, Eigen::Dynamic, Eigen::Dynamic>
      moving;  ///< fast enough, and long enough since it reversed, for friction to be that of sliding
  std::vector<std::pair<Eigen::Index, Eigen::Index>>
      segments;  ///< first and past the last sample of stretches without a gap
  std::vector<double> time_s;
  std::vector<std::size_t> file;       ///< per segment, index of its recording
  std::vector<double> edge_s;          ///< per segment, how much of its stretch was left out at either end
  double cutoff_hz = 0, period_s = 0;  ///< of the first recording
  bool has_temperature = false;
  std::vector<std::string> notes;

  Eigen::Index size() const { return q.cols(); }
};

/// Stretches of regular sampling are filtered (filter.hpp), differentiated by central differences and decimated; jitter
/// is taken out by cubic interpolation. Fails where no stretch of a second is left or a joint stands in all recordings.
Result<JointMotion> prepare(std::span<const RobotRecording> recordings, const Regressor& regressor,
                            const Preparation& preparation = {});

}  // namespace tribotwin::twin::identification
