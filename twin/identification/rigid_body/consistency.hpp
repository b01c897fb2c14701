#pragma once

#include <Eigen/Dense>

#include <tribotwin/twin/robot/base_parameters.hpp>

namespace tribotwin::twin::identification {

/// Whether real bodies can have these base parameters: masses above 0 and inertias that a distribution of mass can have
/// (every pseudo-inertia [[tr(I)/2 - I, mc], [mc', m]] positive definite; Wensing, Kim, Slotine 2018), rotor inertias
/// not below 0.
struct Consistency {
  bool possible = false;  ///< such bodies exist within the noise: distance^2 below the 95 % quantile of chi-squared, as
                          ///< many degrees of freedom as base parameters
  double distance_sigma = 0;  ///< Mahalanobis distance of the estimate from the nearest possible one
  Eigen::VectorXd base;       ///< the nearest possible base parameters
  Eigen::VectorXd
      parameters;  ///< of the bodies that have them, of all such those near the model's; order of the regressor
};

/// The nearest consistent set: (from_all phi - beta)' information (from_all phi - beta) is minimised over phi, each
/// pseudo-inertia being written as L L'. Where `information` is blind the model's parameters decide.
Consistency nearest_consistent(const Regressor& regressor, const BaseParameters& base, const Eigen::VectorXd& beta,
                               const Eigen::MatrixXd& information);

}  // namespace tribotwin::twin::identification
