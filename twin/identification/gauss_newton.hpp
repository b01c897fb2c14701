#pragma once

#include <Eigen/Dense>

#include <tribotwin/twin/numerics/search.hpp>

/// Minimum of a function whose curvature is known about as well as its slope, such as a likelihood of residuals.
namespace tribotwin::twin {

struct GaussNewtonOptions {
  double first_step = 0.1, last_step = 0.02;  ///< of the differences that make a Quadratic, in units of z
  int evaluations = 1000;                     ///< at most; a Quadratic costs z.size() + 1
  double tolerance = 1e-3;                    ///< a smaller gain halves the step of differences, then ends
};

/// Steps of Levenberg and Marquardt within low <= z <= high (infinite: none). Where a function has small cliffs, as a
/// simulation that begins to stick, differences over `first_step` see its trend. Coordinates should be of order 1.
Search gauss_newton(Eigen::VectorXd start, Eigen::VectorXd low, Eigen::VectorXd high, GaussNewtonOptions options);

}  // namespace tribotwin::twin
