#include <cmath>

#include <gtest/gtest.h>

#include <tribotwin/twin/identification/gauss_newton.hpp>

namespace tribotwin::twin {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

/// 50 ln of the mean square of y - a exp(-b t) in the unknowns z = (a, b), with y from (2, 0.7) and a small wave.
struct Decay {
  VectorXd t = VectorXd::LinSpaced(40, 0, 4);
  VectorXd residual(const VectorXd& z) const {
    const VectorXd y = 2 * (-0.7 * t.array()).exp() + 1e-3 * (40 * t.array()).sin();
    return y.array() - z(0) * (-z(1) * t.array()).exp();
  }
  double operator()(const VectorXd& z) const { return 50 * std::log(residual(z).squaredNorm()); }
  Quadratic quadratic(const VectorXd& z, double step) const {
    const VectorXd r = residual(z);
    MatrixXd J(r.size(), z.size());
    for (Index j = 0; j < z.size(); ++j) {
      VectorXd moved = z;
      moved(j) += step;
      J.col(j) = (residual(moved) - r) / step;
    }
    const double weight = 100 / r.squaredNorm();
    return {weight * J.transpose() * r, weight * J.transpose() * J};
  }
};

Minimum minimum(const VectorXd& low, const VectorXd& high, const GaussNewtonOptions& options) {
  const Decay f;
  return answered(
      gauss_newton(VectorXd::Ones(2), low, high, options), [&](const VectorXd& z) { return f(z); },
      [&](const VectorXd& z, double step) { return f.quadratic(z, step); });
}

const VectorXd far = VectorXd::Constant(2, 1e9);

TEST(GaussNewton, FindsTheMinimumInFewEvaluations) {
  const Minimum found = minimum(-far, far, {.first_step = 0.01, .last_step = 1e-6, .tolerance = 1e-9});
  EXPECT_NEAR(found.z(0), 2, 2e-3);
  EXPECT_NEAR(found.z(1), 0.7, 2e-3);
  EXPECT_LT(found.evaluations, 150);
}

TEST(GaussNewton, StopsAtABound) {
  VectorXd high = far;
  high(0) = 1.5;
  const Minimum found = minimum(-far, high, {});
  EXPECT_EQ(found.z(0), 1.5);
  const Decay f;
  for (const double other : {found.z(1) - 0.02, found.z(1) + 0.02})
    EXPECT_GT(f((VectorXd(2) << 1.5, other).finished()), found.objective);
}

TEST(GaussNewton, SpendsNoMoreThanAllowed) {
  for (const int allowed : {1, 4, 9, 20}) EXPECT_LE(minimum(-far, far, {.evaluations = allowed}).evaluations, allowed);
}

}  // namespace
}  // namespace tribotwin::twin
