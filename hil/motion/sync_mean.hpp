#pragma once

#include <algorithm>

namespace tribotwin::hil {

/// The mean of a quantity from one SYNC to the next, as a drive measures its torque: sampled at the SYNC alone, a
/// ripple with the period of the set points would look like a constant. Without SYNCs it is the value of the last step.
class SyncMean {
 public:
  /// Silence after which there is no SYNC any more [s]; twice the last interval, if that is longer.
  static constexpr double longest_silence_s = 0.1;

  /// A step with this value; all are of one dt_s, or 0 where nothing has moved yet.
  void add(double value, double dt_s) {
    elapsed_s_ += dt_s;
    if (dt_s > 0) sum_ += value, ++steps_;
    const bool synced = synced_ && elapsed_s_ <= std::max(longest_silence_s, 2 * interval_s_);
    mean_ = synced && steps_ > 0 ? sum_ / steps_ : value;
  }
  /// A SYNC: what was added since the one before has been reported.
  void sync() {
    constexpr double longest_interval_s = 1;
    interval_s_ = synced_ ? std::min(elapsed_s_, longest_interval_s) : 0;
    synced_ = true;
    elapsed_s_ = sum_ = 0;
    steps_ = 0;
  }
  /// Of the steps since the last SYNC; before the first of them that of the interval before.
  double value() const { return mean_; }

 private:
  bool synced_ = false;
  int steps_ = 0;
  double mean_ = 0, sum_ = 0, elapsed_s_ = 0, interval_s_ = 0;
};

}  // namespace tribotwin::hil
