#pragma once

#include <cstddef>
#include <optional>
#include <vector>

namespace tribotwin::hil {

/// Finds the period of frames from their times: the median interval. Lost frames do not move it. Where a reader took
/// several frames at once, so that most have the time of another, it is the median over eight intervals instead.
class CyclePeriod {
 public:
  static constexpr std::size_t enough = 64;  ///< frames after which the period is final

  /// A frame at this time [s]; in order.
  void add(double time_s);
  std::size_t count() const { return times_.size(); }
  bool complete() const { return times_.size() >= enough; }
  /// None with fewer than three frames, or all at one time.
  std::optional<double> period_s() const;
  /// Half the range of the middle 80 % of the intervals, by the period; 0 for a regular bus.
  double spread() const;

 private:
  std::vector<double> sorted_intervals(std::size_t over) const;
  std::vector<double> times_;
};

}  // namespace tribotwin::hil
