#pragma once

#include <span>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/identification/rigid_body/joint_friction.hpp>
#include <tribotwin/twin/identification/rigid_body/joint_motion.hpp>
#include <tribotwin/twin/robot/base_parameters.hpp>

/// The torques of a robot's motion, tau_j = Y_j(q, qd, qdd) beta + f_j(qd_j, load_j, T_j), from its parameters. The
/// friction f_m of a coupled motor acts on all joints that it turns with, c f_m(c . qd, load_m, T).
namespace tribotwin::twin::identification {

/// The friction of every rotor, in the order of the regressor's: the joints' own, then that of coupled motors.
using RobotFriction = std::vector<JointFriction>;

/// The same law, with the same parts beside it, in every joint and every coupled motor, which has no offset beside its
/// joints'. Laws of motor speed, load or normalised torque take
/// gear ratio and torque_max from the joints' drives. A joint without a drive has its law at arm speeds, its loads and
/// normalised torques in units of its `torque_max_nm` (one per joint). ErrorKind::input where that is needed and empty.
Result<RobotFriction> robot_friction(const mujoco::Model& model, const Regressor& regressor,
                                     const friction::LawInfo& law, Directional directional = {.offset = true},
                                     std::span<const double> torque_max_nm = {});

struct RobotParameters {
  Eigen::VectorXd base;                       ///< in the order of BaseParameters
  std::vector<std::vector<double>> friction;  ///< per rotor, in the law's order
};

/// Whether a rotor's friction may have a part by position: of a hinge, not of a motor that turns with several joints.
bool may_depend_on_position(const Regressor& regressor, Eigen::Index rotor);

/// Friction [Nm; N] of a rotor in a sample of the motion, with its offset and torque by position, which are all that is
/// left at rest: the one place that knows its speed and load.
/// `rigid`: rigid torques [Nm; N] of all joints in the sample. Derivatives by its parameters where not null.
double friction_of(const Regressor& regressor, const RobotFriction& friction, const RobotParameters& parameters,
                   const JointMotion& motion, Eigen::Index rotor, Eigen::Index sample, const Eigen::VectorXd& rigid,
                   double* derivatives = nullptr);

/// The first of the ten columns of the regressor that belong to a body of mjModel; -1 where it does not move.
Eigen::Index first_column(const Regressor& regressor, int body);

/// Torques [Nm; N] that accelerate and lift what the robot carries, by the recordings of `motion`, joints x samples;
/// empty where it carries nothing.
Eigen::MatrixXd carried_torque(const Regressor& regressor, std::span<const std::optional<CarriedBody>> carried,
                               const JointMotion& motion);

/// Torques [Nm; N] of the motors, arm side, joints x samples. At rest friction is 0 but for its offset
/// and torque by position.
Eigen::MatrixXd predicted_torque(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                                 const RobotParameters& parameters, const JointMotion& motion, unsigned threads);

/// Torques [Nm; N] that the gears transmit to the links, joints x samples: rigid dynamics without the inertia of the
/// model's rotors.
Eigen::MatrixXd gear_load(const Regressor& regressor, const BaseParameters& base, const Eigen::VectorXd& parameters,
                          const JointMotion& motion, unsigned threads);

/// Slope of predicted torques by time [Nm/s; N/s], from what is known beside each sample. 0 where nothing is (NaN), and
/// within two periods of the cut-off of a reversal, where torque says little of a lag.
Eigen::MatrixXd slope_by_time(const Eigen::MatrixXd& torque, const Regressor& regressor, const JointMotion& motion);

/// How late a joint's torque is in one recording [s], < 0: early.
struct FileLag {
  std::size_t file;
  Eigen::Index joint;
  double value_s, sigma_s;
};
/// Of every file and joint with at least four seconds of motion, against predicted torques; what was removed before
/// (JointMotion::lag_s) counts. Sigma by the scatter between half seconds, so errors of the prediction are in it.
std::vector<FileLag> lag_of_files(const Regressor& regressor, const JointMotion& motion,
                                  const Eigen::MatrixXd& predicted);

/// How much a joint's lags differ from file to file.
struct LagSpread {
  int files = 0;
  double squares = 0;     ///< about their weighted mean, in units of their sigmas
  double chance() const;  ///< that they differ as much where the lag is one
  double factor() const;  ///< by which the sigma of their mean is to be enlarged, >= 1
};
LagSpread spread_of(std::span<const FileLag> lags, Eigen::Index joint);

}  // namespace tribotwin::twin::identification
