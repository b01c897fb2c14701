#pragma once

#include <Eigen/Dense>

namespace tribotwin::twin {

/// A periodic motion of all joints, a Fourier series each (first section of the cycle of Hao 2021; Swevers 1997):
///
///   qd(t) = sum_k a_k cos(k w t) + b_k sin(k w t),   w = 2 pi / period,
///
/// with sum a_k = 0 and sum k b_k = 0, so that it starts and ends at rest without acceleration.
struct FourierSeries {
  double period_s = 10;
  Eigen::VectorXd centre;  ///< per joint [rad; m]
  Eigen::MatrixXd a, b;    ///< joints x harmonics [rad/s; m/s]

  /// The nearest that starts at rest without acceleration.
  void start_at_rest();
  /// Positions, velocities and accelerations at a time [s]; vectors of joints.
  void at(double time_s, Eigen::Ref<Eigen::VectorXd> q, Eigen::Ref<Eigen::VectorXd> qd,
          Eigen::Ref<Eigen::VectorXd> qdd) const;
};

}  // namespace tribotwin::twin
