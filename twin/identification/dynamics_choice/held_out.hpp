#pragma once

#include <span>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/dynamics_choice/torque_lag.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>

/// How well dynamics predict samples that they were not fitted to.
namespace tribotwin::twin::identification {

/// A way to identify a robot's dynamics.
struct Setting {
  Preparation signals;
  LagOf lag_of = LagOf::joint;
  const friction::LawInfo* law = &coulomb_viscous();
  std::vector<double> stribeck_share;  ///< per rotor, of its largest speed: vs where the law holds one; empty: 0.1
  Directional directional{.offset = true};
  std::vector<std::string> by_position;  ///< joints whose torque has a part by their own position
  Robust robust = Robust::none;
  bool rotor_inertia = true;
  double prior = 0;                  ///< as in DynamicsOptions
  std::vector<CoupledMotor> motors;  ///< that were chosen; those of the given regressor are not among them
};

/// "friction that turns 8 ms before the speed"
std::string turn_text(double lead_s);

/// Options of a fit with this setting; its signals and friction are arguments of their own.
DynamicsOptions options_of(const Setting& setting, unsigned threads);

/// The friction of every joint with this setting, for this motion. Errors as of robot_friction.
Result<RobotFriction> friction_of(const mujoco::Model& model, const Regressor& regressor, const Setting& setting,
                                  std::span<const double> torque_max_nm, const JointMotion& motion);

/// How well torques that were foretold agree with the target's.
struct Errors {
  Eigen::VectorXd rms;   ///< per joint with torque [Nm; N], over the samples in motion
  Eigen::MatrixXd mean;  ///< joints x stretches of time: mean squares
};
struct HeldOut : Errors {
  DynamicsFit fit;  ///< of all samples
};

/// What errors are counted against: the same for every setting.
struct Target {
  JointMotion motion;  ///< torque with the widest band; `moving` says which samples count
  std::vector<std::pair<Eigen::Index, Eigen::Index>> stretches;  ///< samples [first, second): units of comparison
};

/// Fits `motion` (of the same times as the target's) without each of `folds` parts in turn and predicts that part.
/// `start`, `known`: as in DynamicsOptions. ErrorKind::input where the fit fails, and as errors_of.
Result<HeldOut> held_out(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                         const JointMotion& motion, const Setting& setting, const Target& target, unsigned folds,
                         const DynamicsFit* start, const std::vector<Fold>* known, unsigned threads);
/// `predicted`: joints x samples of the target. ErrorKind::input, with the joint, where none of its samples counts or
/// its error is not finite.
Result<Errors> errors_of(const Regressor& regressor, const Eigen::MatrixXd& predicted, const Target& target);

/// Geometric mean over joints of the ratio of errors, less 1; and its standard error from the variation between
/// stretches of time. Below 0: `a` is better.
struct Comparison {
  double change = 0, sigma = 0;
};
Comparison compared(const Errors& a, const Errors& b);

}  // namespace tribotwin::twin::identification
