#pragma once

#include <vector>

namespace tribotwin::twin {

/// How well an arm follows its set point; the figures of the RH380-N study, section 5.3.
class TrackingError {
 public:
  /// One sample per time step: arm's set point and position [rad], and whether the set point rests.
  void add(double set_point_rad, double position_rad, bool rests, double dt_s);
  /// Mean of |set point - position| over all samples [mrad]: the L1 norm over the duration.
  double l1_mrad() const { return samples_ ? 1e3 * sum_rad_ / static_cast<double>(samples_) : 0; }
  /// Max. peak-to-peak oscillation of the arm [mrad] in any half second at rest, without the first `settling_s` of a
  /// rest. A parabola over that time is subtracted, so that slow motion of the load does not count. 0 without such a
  /// time.
  double standstill_pp_mrad() const { return 1e3 * oscillation_rad_; }
  static constexpr double settling_s = 1, window_s = 0.5;

 private:
  double sum_rad_ = 0, oscillation_rad_ = 0, rested_s_ = 0;
  long samples_ = 0;
  std::vector<double> window_rad_;
};

}  // namespace tribotwin::twin
