#pragma once

#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/experiments/working_days/working_day.hpp>
#include <tribotwin/twin/identification/rigid_body/robot_torque.hpp>

/// Internal to this folder, not installed.
namespace tribotwin::twin::repeatability {

inline constexpr double reference_degC = 20;  ///< T0 of the law, at the start of the day

/// Friction of all joints over the day: the motors' torques without rigid dynamics.
class DayFriction {
 public:
  /// `reference`: parameters with, per joint, the friction curve of which the present one is a multiple. `level_speed`
  /// [rad/s] per joint.
  DayFriction(const Regressor& regressor, const BaseParameters& base, const identification::RobotFriction& law,
              identification::RobotParameters reference, const Eigen::VectorXd& level_speed);

  /// Adds the next motion. Returns each joint's friction at the level speed, from its samples in motion after `from_s`.
  std::vector<Measured> add(const identification::JointMotion& motion, double from_s);

  /// Per joint, from all motion so far.
  std::vector<Warming> warming() const;

 private:
  struct Point {
    double time_s, work_J, friction_nm;
  };
  struct Points {
    double work_J = 0;  ///< of friction since the start of the day
    std::vector<Point> kept;
  };
  double curve(Eigen::Index j, double speed, double direction) const;
  void add_windows(const identification::JointMotion& motion, const Eigen::MatrixXd& rest, Eigen::Index j,
                   Eigen::Index first, Eigen::Index past);

  const Regressor& regressor_;
  const BaseParameters& base_;
  const identification::RobotFriction& law_;
  identification::RobotParameters reference_, rigid_;
  std::vector<double> level_nm_;
  std::vector<Points> points_;
};

}  // namespace tribotwin::twin::repeatability
