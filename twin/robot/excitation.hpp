#pragma once

#include <atomic>
#include <functional>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/robot/base_parameters.hpp>
#include <tribotwin/twin/robot/fourier.hpp>
#include <tribotwin/twin/robot/motion.hpp>

/// Motion from which a robot's dynamics are identified: the cycle of three sections of Hao 2021. Inertia: Fourier
/// series of all joints whose coefficients make the condition number of the base regressor small. Friction: joint by
/// joint, several speeds both ways, the others in a stated pose. Heating: fast point-to-point moves of all joints.
/// With a DesignCriterion the series and the second section are D-optimal for it: the second is then chosen from passes
/// at constant speed of one joint or all, around several poses, in the time that the passes joint by joint would take.
namespace tribotwin::twin {

/// The limits of the motion, per joint of the regressor.
struct MotionLimits {
  Eigen::VectorXd low, high;  ///< positions [rad; m]
  Eigen::VectorXd speed, acceleration;
  Eigen::VectorXd torque;          ///< of the motor, arm side; infinite where the model names none
  std::vector<std::string> notes;  ///< assumptions
};

/// Range of the joints less 2 % of it at each end; the model's numeric `joint_speed_max_rad_s` (per drive; else 2
/// rad/s); the acceleration that reaches it in 0.4 s; ctrlrange of the drives. Speeds and torques times `share`.
MotionLimits motion_limits(const mujoco::Model& model, const Regressor& regressor, double share);

/// States of a motion at equal steps of time; joints x states.
struct MotionStates {
  double step_s = 0;
  Eigen::MatrixXd q, qd, qdd;  ///< [rad; m], per s, per s^2

  Eigen::Index size() const { return q.cols(); }
};

/// What a motion is for, in place of a small condition number: a large ln det(known + information), D-optimality.
struct DesignCriterion {
  Eigen::MatrixXd known;  ///< information without the motion, positive definite
  /// Of a motion; that of several adds up. Symmetric, lower triangle.
  std::function<Eigen::MatrixXd(const MotionStates&)> information;
};

struct ExcitationOptions {
  double share = 0.8;  ///< of the speeds and torques
  double period_s = 10;
  int harmonics = 5;
  int periods = 2;         ///< of the series, one after the other
  double heating_s = 180;  ///< 0: none
  bool friction = true;
  int evaluations = 4000;
  std::uint64_t seed = 1;
  const DesignCriterion* criterion = nullptr;  ///< null: the condition number decides on the first section
  const std::atomic<bool>* stop = nullptr;     ///< ends the search; the best motion so far is the result
  std::function<void(double share)> progress;
};

struct Excitation {
  FourierSeries inertia;
  double inertia_s = 0;   ///< end of the first section
  double friction_s = 0;  ///< end of the second
  Motion rest;            ///< second and third section, from inertia_s on
  double condition_number =
      0;  ///< of base regressor, Coulomb and viscous columns over the first section; every column in units of its rms
          ///< at random states within the limits, every row in units of the joint's torque
  double first_condition_number = 0;  ///< of the first motion tried that keeps the limits
  Eigen::VectorXd pose;               ///< of the joints that rest in the second section
  bool interrupted = false;
  std::vector<std::string> notes;

  double duration_s() const { return inertia_s + rest.duration_s(); }
  /// The first `until_s` seconds.
  MotionStates states(double step_s, double until_s) const;
  /// Set points at a time [s], per joint.
  void at(double time_s, std::span<SetPoint> out) const;
  /// 1, 2 or 3.
  int section(double time_s) const { return time_s < inertia_s ? 1 : time_s < friction_s ? 2 : 3; }
};

/// Set points as CSV: time_s, section, position_JOINT_rad|_m, velocity_JOINT_rad_s|_m_s.
std::string to_csv(const Excitation& excitation, const Regressor& regressor, double rate_hz);

/// Fails where no motion within the limits was found.
Result<Excitation> excite(const mujoco::Model& model, const Regressor& regressor, const BaseParameters& base,
                          const ExcitationOptions& options = {});

}  // namespace tribotwin::twin
