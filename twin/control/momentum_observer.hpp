#pragma once

#include <cmath>

namespace tribotwin::twin {

/// Generalised-momentum observer (RH380-N study, equations 7 to 10): sees, through the gain [1/s] of a first-order lag,
/// the torque that slows a rotor beside what is known to act on it, without its acceleration: r' = K (known torque - r
/// - p').
class MomentumObserver {
 public:
  explicit MomentumObserver(double gain_1_s) : gain_1_s_(gain_1_s) {}

  /// After dt [s] in which `known_nm` acted on a momentum that became `momentum` [kg m^2/s]; exact for torques that
  /// were constant meanwhile. The first call only learns the momentum.
  double update(double known_nm, double momentum, double dt_s) {
    if (fresh_) momentum_ = momentum, fresh_ = false;
    const double unknown = known_nm - (momentum - momentum_) / dt_s;
    momentum_ = momentum;
    return residual_nm_ -= (unknown - residual_nm_) * std::expm1(-gain_1_s_ * dt_s);
  }
  /// Torque against the motion that is not known [Nm].
  double residual_nm() const { return residual_nm_; }

 private:
  double gain_1_s_, residual_nm_ = 0, momentum_ = 0;
  bool fresh_ = true;
};

}  // namespace tribotwin::twin
