#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <tribotwin/twin/identification/verdict/torque_band.hpp>
#include <tribotwin/twin/numerics/correlation.hpp>

namespace tribotwin::twin::identification {

using Eigen::Index;

namespace {

/// Of the samples in which the joint moves and a prediction is known.
std::vector<double> held_out_errors(const JointMotion& motion, const Eigen::MatrixXd& held_out, Index joint) {
  std::vector<double> out;
  for (Index i = 0; i < motion.size(); ++i)
    if (const double e = motion.torque(joint, i) - held_out(joint, i); motion.moving(joint, i) && std::isfinite(e))
      out.push_back(e);
  return out;
}

}  // namespace

Eigen::VectorXd band_of(const JointMotion& motion, const Eigen::MatrixXd& held_out) {
  constexpr double inside = 0.95;
  Eigen::VectorXd out = Eigen::VectorXd::Constant(held_out.rows(), std::numeric_limits<double>::quiet_NaN());
  for (Index j = 0; j < held_out.rows(); ++j) {
    std::vector<double> errors = held_out_errors(motion, held_out, j);
    for (double& e : errors) e = std::abs(e);
    if (errors.empty()) continue;
    const auto at = errors.begin() + static_cast<std::ptrdiff_t>(inside * static_cast<double>(errors.size() - 1));
    std::ranges::nth_element(errors, at);
    out(j) = *at;
  }
  return out;
}

double independent_errors(std::span<const double> errors, const JointMotion& motion) {
  if (errors.empty()) return 0;
  const double n = static_cast<double>(errors.size()), periods = n * motion.period_s * motion.cutoff_hz;
  return std::min(n / samples_per_independent(errors, 0), std::max(1.0, periods));
}

Eigen::VectorXd independent_of_band(const JointMotion& motion, const Eigen::MatrixXd& held_out) {
  Eigen::VectorXd out(held_out.rows());
  for (Index j = 0; j < held_out.rows(); ++j) out(j) = independent_errors(held_out_errors(motion, held_out, j), motion);
  return out;
}

}  // namespace tribotwin::twin::identification
