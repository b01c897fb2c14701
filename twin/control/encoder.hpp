#pragma once

#include <cmath>
#include <numbers>
#include <utility>

#include <tribotwin/twin/control/state_numbers.hpp>

namespace tribotwin::twin {

/// A motor encoder with whole counts, and the second-order tracking loop from which a drive gets the speed: critically
/// damped, so that a step of one count appears as a speed of at most 0.74 bandwidth counts. Angles are those of the
/// joint, with `gear_ratio` motor turns per joint turn.
class Encoder {
 public:
  /// No encoder: angle and speed are exact.
  Encoder() = default;
  Encoder(double counts_per_turn, double gear_ratio, double bandwidth_rad_s)
      : resolution_rad_(2 * std::numbers::pi / counts_per_turn / gear_ratio), bandwidth_(bandwidth_rad_s) {}

  /// Reads the angle [rad] and speed [rad/s], dt [s] after the last call. Call it once per time step, the first time
  /// with any dt.
  void read(double angle_rad, double speed_rad_s, double dt_s) {
    if (resolution_rad_ == 0) return void((angle_ = angle_rad, speed_ = speed_rad_s));
    angle_ = resolution_rad_ * std::floor(angle_rad / resolution_rad_ + 0.5);
    if (std::exchange(fresh_, false)) tracked_ = angle_;
    // Exact for an angle held over the step: (tracked - angle, speed) decays with a double pole.
    const double b = bandwidth_, e = std::exp(-b * dt_s), away = tracked_ - angle_, c = speed_ + b * away;
    tracked_ = angle_ + (away + c * dt_s) * e;
    speed_ = (speed_ - b * c * dt_s) * e;
  }
  double angle_rad() const { return angle_; }
  double speed_rad_s() const { return speed_; }
  double resolution_rad() const { return resolution_rad_; }
  void state(StateNumbers& s) { s(angle_), s(speed_), s(tracked_), s(fresh_); }

 private:
  double resolution_rad_ = 0, bandwidth_ = 0, angle_ = 0, speed_ = 0, tracked_ = 0;
  bool fresh_ = true;
};

}  // namespace tribotwin::twin
