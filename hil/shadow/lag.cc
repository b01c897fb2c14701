#include <cmath>

#include <tribotwin/hil/shadow/lag.hpp>

namespace tribotwin::hil {

void Lag::add(double a, double b) {
  if (!std::exchange(begun_, true)) a0_ = a, b0_ = b;
  recent_.emplace_back(a - a0_, b - b0_);
  if (recent_.size() > static_cast<std::size_t>(limit) + 1) recent_.pop_front();
  const auto& now = recent_.back();
  for (std::size_t back = 0; back < recent_.size(); ++back) {
    const auto& then = recent_[recent_.size() - 1 - back];
    sums_[static_cast<std::size_t>(limit) + back].add(then.first, now.second);
    if (back > 0) sums_[static_cast<std::size_t>(limit) - back].add(now.first, then.second);
  }
}

int Lag::samples() const {
  if (sums_[0].n < 2 * limit) return 0;
  int best = 0;
  double maximum = sums_[static_cast<std::size_t>(limit)].covariance();
  for (int shift = -limit; shift <= limit; ++shift)
    if (const double c = sums_[static_cast<std::size_t>(shift + limit)].covariance();
        c > maximum + 1e-9 * std::abs(maximum))
      maximum = c, best = shift;
  return best;
}

}  // namespace tribotwin::hil
