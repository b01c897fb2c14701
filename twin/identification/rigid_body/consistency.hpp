#pragma once

#include <Eigen/Dense>

#include <tribotwin/twin/robot/base_parameters.hpp>

namespace tribotwin::twin::identification {

/// Physical consistency of base parameters: bodies of positive mass with a pseudo-inertia [[tr(I)/2 - I, mc], [mc', m]]
/// that is positive definite (Wensing 2018), rotor inertias >= 0.
struct Consistency {
  bool possible = false;  ///< within the noise: distance^2 below the 95 % quantile of chi-squared with one degree of
                          ///< freedom per base parameter
  double distance_sigma = 0;   ///< Mahalanobis distance of the estimate from the nearest consistent one
  Eigen::VectorXd base;        ///< the nearest consistent base parameters
  Eigen::VectorXd parameters;  ///< of bodies that have them, those nearest to the model's; order of the regressor
};

/// The nearest consistent set: minimises (from_all phi - beta)' information (from_all phi - beta) over phi, each
/// pseudo-inertia written as L L'. Where `information` is 0 the model's parameters decide.
Consistency nearest_consistent(const Regressor& regressor, const BaseParameters& base, const Eigen::VectorXd& beta,
                               const Eigen::MatrixXd& information);

}  // namespace tribotwin::twin::identification
