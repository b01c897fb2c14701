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

Search gauss_newton(VectorXd start, VectorXd low, VectorXd high, GaussNewtonOptions options) {
  Trial trial{{start.cwiseMax(low).cwiseMin(high)}};
  const Tried first = co_await trial;
  Minimum best{trial.points[0], first.values[0], 1};
  const int slope_cost = static_cast<int>(start.size()) + 1;
  double damping = 1, step = options.first_step;
  while (start.size() > 0 && std::isfinite(best.objective) && step >= options.last_step &&
         best.evaluations + slope_cost < options.evaluations) {
    trial = {{best.z}, step};
    const Tried around = co_await trial;
    best.evaluations += slope_cost;
    const double before = best.objective;
    for (int k = 0; k < dampings && best.evaluations < options.evaluations; ++k) {
      const VectorXd z = (best.z + step_of(around.quadratic, damping, best.z, low, high)).cwiseMax(low).cwiseMin(high);
      trial = {{z}};
      const Tried tried = co_await trial;
      ++best.evaluations;
      if (tried.values[0] < best.objective) {
        best.z = z, best.objective = tried.values[0];
        damping = std::max(1e-4, damping / 5);
        break;
      }
      damping *= 4;
    }
    if (before - best.objective < options.tolerance) step /= 2, damping = std::min(damping, 1.0);
  }
  co_return best;
}

}  // namespace tribotwin::twin
