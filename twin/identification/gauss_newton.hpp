#pragma once

#include <functional>

#include <Eigen/Dense>

#include <tribotwin/twin/numerics/cma_es.hpp>

/// Minimum of a function whose curvature is known about as well as its slope, such as a likelihood of residuals.
namespace tribotwin::twin {

/// Slope and (Gauss-Newton's) positive semidefinite curvature at a point.
struct Quadratic {
  Eigen::VectorXd gradient;
  Eigen::MatrixXd curvature;
};

struct GaussNewtonOptions {
  double first_step = 0.1, last_step = 0.02;  ///< of the differences that `quadratic` makes, in units of z
  int evaluations = 1000;                     ///< at most; a quadratic costs z.size() + 1
  double tolerance = 1e-3;                    ///< a smaller gain halves the step of differences, then ends
};

/// Steps of Levenberg and Marquardt within low <= z <= high (infinite: none). Where a function has small cliffs, as a
/// simulation that begins to stick, differences over `first_step` see its trend. Coordinates should be of order 1.
Minimum gauss_newton(const std::function<double(const Eigen::VectorXd&)>& objective,
                     const std::function<Quadratic(const Eigen::VectorXd&, double step)>& quadratic,
                     const Eigen::VectorXd& start, const Eigen::VectorXd& low, const Eigen::VectorXd& high,
                     const GaussNewtonOptions& options);

}  // namespace tribotwin::twin
