#pragma once

#include <optional>
#include <string_view>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/samples/samples.hpp>

/// What residuals have in common along speed, load or temperature: arcs of a law that does not follow the data. They
/// are taken as correlated noise (numerics/correlated_noise.hpp) along the axis whose arcs move the parameters most.
namespace tribotwin::twin::identification {

struct Misfit {
  std::string_view along;      ///< "speed", "load", "temperature", or speed in each curve by itself
  double share = 0;            ///< of the mean square of the residuals, in arcs
  double freedom = 0;          ///< degrees of freedom of their variance: the number of arcs, three at least
  Eigen::MatrixXd covariance;  ///< of the columns of the Jacobian, arcs included
};

/// Of the residuals of a least-squares fit with this Jacobian (samples x free parameters, rows and residuals in units
/// of their standard error). None where neighbours have nothing in common that noise could not have, or where the
/// samples are too few to see it: fewer than eight more than parameters.
std::optional<Misfit> misfit_of(const Samples& samples, const Eigen::VectorXd& residual,
                                const Eigen::MatrixXd& jacobian);

}  // namespace tribotwin::twin::identification
