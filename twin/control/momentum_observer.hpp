#pragma once

#include <cmath>

#include <tribotwin/twin/control/state_numbers.hpp>

namespace tribotwin::twin {

/// Generalised-momentum observer (RH380-N study, equations 7 to 10): estimates the unknown torque that slows a rotor,
/// with a first-order lag of gain K [1/s] and without the acceleration: r' = K (known torque - r - p').
class MomentumObserver {
 public:
  explicit MomentumObserver(double gain_1_s) : gain_1_s_(gain_1_s) {}

  /// Advances by dt [s] in which `known_nm` acted; `momentum` [kg m^2/s] is that at the end. Exact for constant
  /// torques. The first call only stores the momentum.
  double update(double known_nm, double momentum, double dt_s) {
    if (fresh_) momentum_ = momentum, fresh_ = false;
    const double unknown = known_nm - (momentum - momentum_) / dt_s;
    momentum_ = momentum;
    return residual_nm_ -= (unknown - residual_nm_) * std::expm1(-gain_1_s_ * dt_s);
  }
  /// Unknown torque against the motion [Nm].
  double residual_nm() const { return residual_nm_; }
  void state(StateNumbers& s) { s(residual_nm_), s(momentum_), s(fresh_); }

 private:
  double gain_1_s_, residual_nm_ = 0, momentum_ = 0;
  bool fresh_ = true;
};

}  // namespace tribotwin::twin
