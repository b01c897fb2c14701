#include <algorithm>
#include <cmath>

#include <Eigen/Dense>

#include <tribotwin/twin/control/tracking.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin {
namespace {

double oscillation(const std::vector<double>& x) {
  const auto n = std::ssize(x);
  const Eigen::ArrayXd t = Eigen::ArrayXd::LinSpaced(n, -1, 1);
  Eigen::MatrixXd basis(n, 3);
  basis << Eigen::VectorXd::Ones(n), t, t.square();
  const Eigen::Map<const Eigen::VectorXd> y(x.data(), n);
  const Eigen::VectorXd left = y - basis * least_squares_solution(basis, y);
  return left.maxCoeff() - left.minCoeff();
}

}  // namespace

void TrackingError::add(double set_point_rad, double position_rad, bool rests, double dt_s) {
  sum_rad_ += std::abs(set_point_rad - position_rad);
  ++samples_;
  rested_s_ = rests ? rested_s_ + dt_s : 0;
  if (rested_s_ <= settling_s) return window_rad_.clear();
  window_rad_.push_back(position_rad);
  if (static_cast<double>(window_rad_.size()) * dt_s < window_s) return;
  oscillation_rad_ = std::max(oscillation_rad_, oscillation(window_rad_));
  window_rad_.clear();
}

}  // namespace tribotwin::twin
