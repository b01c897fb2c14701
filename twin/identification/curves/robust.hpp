#pragma once

#include <vector>

#include <tribotwin/twin/identification/curves/fit.hpp>
#include <tribotwin/twin/identification/curves/separable.hpp>

/// M-estimates: losses that grow more slowly than the square, by iteratively reweighted least squares.
namespace tribotwin::twin::identification {

/// Standard deviation of residuals from their median magnitude, for residuals that are normal but for a few outliers.
/// `base`: weight per sample, empty for 1 each.
double robust_scale(const std::vector<double>& residuals, const std::vector<double>& base);

/// Weights by which least squares minimise a robust loss near these residuals; `base` itself where no scale is left.
std::vector<double> robust_weights(const std::vector<double>& residuals, const std::vector<double>& base, Loss loss);

/// The minimum of a robust loss, from the minimum of squares. Leaves the last weights in `problem`.
Point robust_minimum(const Samples& samples, const std::vector<double>& base, Loss loss, Separable& problem,
                     Point squares, unsigned threads);

/// The variance that turns the information of unweighted samples into covariance:
/// scale^2 mean(psi^2) / mean(psi')^2. `squares` is returned where the loss is flat everywhere.
double robust_variance(const std::vector<double>& residuals, const std::vector<double>& base, Loss loss,
                       double squares);

}  // namespace tribotwin::twin::identification
