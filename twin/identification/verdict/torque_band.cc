#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <tribotwin/twin/identification/verdict/torque_band.hpp>

namespace tribotwin::twin::identification {

using Eigen::Index;

Eigen::VectorXd band_of(const JointMotion& motion, const Eigen::MatrixXd& held_out) {
  constexpr double inside = 0.95;
  Eigen::VectorXd out = Eigen::VectorXd::Constant(held_out.rows(), std::numeric_limits<double>::quiet_NaN());
  for (Index j = 0; j < held_out.rows(); ++j) {
    std::vector<double> errors;
    for (Index i = 0; i < motion.size(); ++i)
      if (const double e = std::abs(motion.torque(j, i) - held_out(j, i)); motion.moving(j, i) && std::isfinite(e))
        errors.push_back(e);
    if (errors.empty()) continue;
    const auto at = errors.begin() + static_cast<std::ptrdiff_t>(inside * static_cast<double>(errors.size() - 1));
    std::ranges::nth_element(errors, at);
    out(j) = *at;
  }
  return out;
}

}  // namespace tribotwin::twin::identification
