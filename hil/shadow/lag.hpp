#pragma once

#include <array>
#include <deque>
#include <utility>

namespace tribotwin::hil {

/// By how many samples a signal `b` follows `a`: the maximum of their covariance within +-limit. Keeps sums and the
/// last 2 limit samples, whatever the length of the session.
class Lag {
 public:
  static constexpr int limit = 50;

  void add(double a, double b);
  /// After a gap: what comes does not follow what was.
  void restart() { recent_.clear(); }
  /// 0 with too few samples to tell.
  int samples() const;

 private:
  struct Sums {
    double n = 0, a = 0, b = 0, ab = 0;
    void add(double x, double y) { ++n, a += x, b += y, ab += x * y; }
    double covariance() const { return n > 0 ? (ab - a * b / n) / n : 0; }
  };
  std::array<Sums, 2 * limit + 1> sums_{};  // of the shift -limit, .., limit
  std::deque<std::pair<double, double>> recent_;
  double a0_ = 0, b0_ = 0;  // first values: sums of differences keep their digits
  bool begun_ = false;
};

}  // namespace tribotwin::hil
