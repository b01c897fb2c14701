#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/estimates.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

/// Internal to identification/, not installed: estimates of a nonlinear fit from its derivatives at the minimum.
namespace tribotwin::twin::identification {

/// Inverse of the information J^T J; directions without information get the variance 1e30.
inline Eigen::MatrixXd covariance_of(const Eigen::MatrixXd& jacobian) {
  const Eigen::VectorXd scale = jacobian.colwise().norm().cwiseMax(1e-300).cwiseInverse();
  const Eigen::MatrixXd unit = jacobian * scale.asDiagonal();
  const SymmetricEigen eigen = symmetric_eigen(unit.transpose() * unit);
  const Eigen::VectorXd inverse =
      eigen.values.unaryExpr([](double information) { return information > 1e-12 ? 1 / information : 1e30; });
  return scale.asDiagonal() * (eigen.vectors * inverse.asDiagonal() * eigen.vectors.transpose()) * scale.asDiagonal();
}

/// Half width of a 95 % interval in sigmas, for `freedom` degrees of freedom; fewer than 1 count as 1.
inline double interval_sigmas(double freedom) { return student_t_quantile(std::max(1.0, freedom), 0.975); }

/// With a 95 % interval of `quantile` sigmas to either side.
inline Estimate estimate(std::string name, std::string unit, double value, double variance, double quantile) {
  const double sigma = std::sqrt(variance);
  return {.name = std::move(name),
          .unit = std::move(unit),
          .value = value,
          .sigma = sigma,
          .low = value - quantile * sigma,
          .high = value + quantile * sigma};
}

inline Estimate without_sigma(std::string name, std::string unit, double value, Status status) {
  constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
  return {std::move(name), std::move(unit), value, unknown, unknown, unknown, status};
}

}  // namespace tribotwin::twin::identification
