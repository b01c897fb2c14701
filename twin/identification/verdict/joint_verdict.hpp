#pragma once

#include <span>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/rigid_body/joint_motion.hpp>
#include <tribotwin/twin/robot/regressor.hpp>

/// What a prediction of a robot's torques leaves unexplained in every joint, and what that depends on.
///
/// Residuals are averaged in bins of speed, load, position, time and temperature. The means of a bin's visits
/// (stretches of time that the joint spends in it without a break) say how well the mean of the bin is known, whatever
/// the correlation of the residuals from sample to sample: a one-way analysis of variance between visits.
namespace tribotwin::twin::identification {

/// Of a joint's residual on one quantity.
struct Dependence {
  std::string on;     ///< "speed", "load", "position", "time", "temperature", "speed of JOINT"
  double share = 0;   ///< of the residual's mean square, beyond what visits vary by: 0 .. 1
  double chance = 1;  ///< that noise makes the bins differ as much
  double growth = 0;  ///< correlation of the bins' means with the quantity: -1 .. 1
  /// Means of the residual [Nm; N] over the quantity; of load and temperature those of residual times sgn(speed).
  struct Bin {
    double from, to, mean, sigma;
  };
  std::vector<Bin> bins;  ///< [rad/s, Nm, rad, s, degC; m/s, N, m of slides]; empty where visits are too few, time
                          ///< where less than 40 s of motion

  bool shown() const { return share >= 0.1 && chance < 1e-3; }
};

/// A share of the residual's mean square by frequency.
struct Octave {
  double from_hz, to_hz, share;
};

struct JointVerdict {
  std::string joint;
  double relative_error = 0;           ///< rms of the residual / rms of the torque, while the joint moves
  double of_variation = 0;             ///< rms of the residual / standard deviation of the torque: without its constant
  double rms = 0;                      ///< of the residual [Nm; N]
  Eigen::Index samples = 0;            ///< in motion
  std::vector<Dependence> dependence;  ///< the four or five; on the speeds of other joints (coupled motors) only where
                                       ///< the joint is badly explained and they matter
  std::vector<Octave> octaves;         ///< fastest first; the last from 0
  double half_below_hz = 0;            ///< half of the residual's mean square is slower
  double white_half_hz = 0;            ///< the same of white noise in the band

  /// 30 % of the torque's variation or more.
  bool badly_explained() const { return of_variation >= 0.3; }
};

/// `predicted`, `gear_load`: joints x samples, as predicted_torque and gear_load give them. Samples in motion count.
/// Joints with fewer than 20 of them have `samples` alone.
std::vector<JointVerdict> judge_joints(const Regressor& regressor, const JointMotion& motion,
                                       const Eigen::MatrixXd& predicted, const Eigen::MatrixXd& gear_load);

/// A line for every joint that is badly explained, largest dependence first: "joint elbow: 31 % of its torque's
/// variation is unexplained; the residual grows with load (40 % of it): a law with load would help".
std::vector<std::string> warnings_of(std::span<const JointVerdict> all);

/// The names of the joints that are badly explained.
std::vector<std::string> badly_explained(std::span<const JointVerdict> all);

}  // namespace tribotwin::twin::identification
