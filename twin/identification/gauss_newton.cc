#include <algorithm>
#include <cmath>

#include <tribotwin/twin/identification/gauss_newton.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

namespace {

constexpr int dampings = 6;  ///< tried from one point

/// The damped step; directions that lead out of a bound at which z lies are left out.
VectorXd step_of(const Quadratic& q, double damping, const VectorXd& z, const VectorXd& low, const VectorXd& high) {
  MatrixXd A = q.curvature;
  VectorXd b = -q.gradient;
  for (Index i = 0; i < z.size(); ++i) {
    const bool held = (z(i) <= low(i) && b(i) < 0) || (z(i) >= high(i) && b(i) > 0);
    if (held) A.row(i).setZero(), A.col(i).setZero(), b(i) = 0;
    A(i, i) += damping * std::max(1.0, A(i, i));
  }
  return symmetric_solution(A, b);
}

}  // namespace

Minimum gauss_newton(const std::function<double(const VectorXd&)>& objective,
                     const std::function<Quadratic(const VectorXd&, double)>& quadratic, const VectorXd& start,
                     const VectorXd& low, const VectorXd& high, const GaussNewtonOptions& options) {
  Minimum best{start.cwiseMax(low).cwiseMin(high), 0, 1};
  best.objective = objective(best.z);
  const int slope_cost = static_cast<int>(start.size()) + 1;
  double damping = 1, step = options.first_step;
  while (start.size() > 0 && std::isfinite(best.objective) && step >= options.last_step &&
         best.evaluations + slope_cost < options.evaluations) {
    const Quadratic q = quadratic(best.z, step);
    best.evaluations += slope_cost;
    const double before = best.objective;
    for (int k = 0; k < dampings && best.evaluations < options.evaluations; ++k) {
      const VectorXd z = (best.z + step_of(q, damping, best.z, low, high)).cwiseMax(low).cwiseMin(high);
      const double tried = objective(z);
      ++best.evaluations;
      if (tried < best.objective) {
        best.z = z, best.objective = tried;
        damping = std::max(1e-4, damping / 5);
        break;
      }
      damping *= 4;
    }
    if (before - best.objective < options.tolerance) step /= 2, damping = std::min(damping, 1.0);
  }
  return best;
}

}  // namespace tribotwin::twin
