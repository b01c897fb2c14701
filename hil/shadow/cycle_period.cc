#include <algorithm>

#include <tribotwin/hil/shadow/cycle_period.hpp>

namespace tribotwin::hil {

void CyclePeriod::add(double time_s) {
  if (!complete()) times_.push_back(time_s);
}

std::vector<double> CyclePeriod::sorted_intervals(std::size_t over) const {
  std::vector<double> intervals;
  for (std::size_t i = over; i < times_.size(); ++i)
    intervals.push_back((times_[i] - times_[i - over]) / static_cast<double>(over));
  std::ranges::sort(intervals);
  return intervals;
}

std::optional<double> CyclePeriod::period_s() const {
  if (times_.size() < 3) return std::nullopt;
  const auto single = sorted_intervals(1), eight = sorted_intervals(std::min<std::size_t>(8, times_.size() - 1));
  const double median = single[single.size() / 2], slow = eight[eight.size() / 2];
  const double period = median < slow / 2 ? slow : median;
  if (period <= 0) return std::nullopt;
  return period;
}

double CyclePeriod::spread() const {
  const auto period = period_s();
  if (!period) return 0;
  const auto intervals = sorted_intervals(1);
  const std::size_t tenth = intervals.size() / 10;
  return (intervals[intervals.size() - 1 - tenth] - intervals[tenth]) / 2 / *period;
}

}  // namespace tribotwin::hil
