#pragma once

#include <functional>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/identification/curves/fit.hpp>
#include <tribotwin/twin/identification/rigid_body/joint_friction.hpp>
#include <tribotwin/twin/identification/rigid_body/robot_recording.hpp>
#include <tribotwin/twin/robot/base_parameters.hpp>

/// A robot's whole dynamics from its motion: base inertial parameters and the friction of every joint at once,
///
///   tau_j = Y_j(q, qd, qdd) beta + f_j(qd_j, load_j, T_j),
///
/// papers 3 and 5. The sum of squares, weighed by each joint's noise, is minimised by Gauss-Newton: the equations are
/// linear in beta and in most of the friction, so that a linear law needs one step. Rows where the joint rests are left
/// out: there friction is whatever holds it. The regressor is never in memory (TriangularFactor). Sigmas: information
/// of the weighed rows, where a joint's noise power counts as often as its residuals are correlated in time.
namespace tribotwin::twin::identification {

enum class Robust {
  none,
  huber,  ///< linear beyond 1.345 sigma
  tukey   ///< nothing beyond 4.685 sigma
};

struct DynamicsOptions {
  Robust robust = Robust::none;
  bool weigh = true;            ///< joints by their noise
  bool essential_only = false;  ///< base parameters that do not better the fit are 0: backward elimination while F < 4
  unsigned threads = 2;
  std::function<void(double share)> progress;
};

/// What the friction of every joint is, in the order of the regressor's joints.
using RobotFriction = std::vector<JointFriction>;

/// The same law in every joint. Laws that take the motor's speed, loads or normalised torque need the joints' drives.
/// Fails with the joint and what it lacks.
Result<RobotFriction> robot_friction(const mujoco::Model& model, const Regressor& regressor,
                                     const friction::LawInfo& law);

/// The parameters of a robot's dynamics: what predicts its torques.
struct RobotParameters {
  Eigen::VectorXd base;                       ///< in the order of BaseParameters
  std::vector<std::vector<double>> friction;  ///< per joint, in the law's order
};

/// Torques [Nm; N], joints x samples, of this motion. At rest friction is 0.
Eigen::MatrixXd predicted_torque(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                                 const RobotParameters& parameters, const JointMotion& motion, unsigned threads);

/// Torques [Nm; N] that the gears transmit to the links, joints x samples: rigid dynamics less what the model's rotors
/// need.
Eigen::MatrixXd gear_load(const Regressor& regressor, const BaseParameters& base, const Eigen::VectorXd& parameters,
                          const JointMotion& motion, unsigned threads);

struct JointResult {
  std::string name;
  double noise = 0;           ///< standard deviation of the residual [Nm; N]
  double correlation = 1;     ///< how many correlated samples are worth one
  double relative_error = 0;  ///< rms of the residual / rms of the torque, while the joint moves
  Eigen::Index samples = 0;   ///< in motion
};

struct DynamicsFit {
  std::vector<Estimate> base;  ///< names as in BaseParameters; `held` at the model's value where these data cannot tell
                               ///< it, at 0 where it is not essential
  std::vector<std::vector<Estimate>> friction;  ///< per joint
  RobotParameters parameters;                   ///< the values of both
  Eigen::MatrixXd information;  ///< of beta, friction free: inverse of its covariance; 0 rows where held
  std::vector<JointResult> joints;
  double relative_error = 0;    ///< |residual| / |torque| over all joints and samples in motion
  double condition_number = 0;  ///< of the weighed regressor with unit columns
  std::vector<std::string> notes;
};

/// Fails with a sentence on what the data lack or cannot be.
Result<DynamicsFit> fit_dynamics(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                                 const JointMotion& motion, const DynamicsOptions& options = {});

}  // namespace tribotwin::twin::identification
