#pragma once

#include <Eigen/Dense>

#include <tribotwin/twin/robot/base_parameters.hpp>
#include <tribotwin/twin/robot/regressor.hpp>

/// What the model says of a robot's inertial parameters before anything is recorded, and how far the data believe it.
namespace tribotwin::twin {

/// The size of every inertial parameter of the model, in the order of the regressor: of a body with mass m and radius
/// of gyration r its m, m r and m r^2; a rotor's own inertia. Bodies without mass count as a hundredth of the heaviest.
Eigen::VectorXd inertial_scale(const Regressor& regressor);

/// Covariance of the base parameters where each inertial parameter is the model's within its own size (one standard
/// deviation). A prior of a share s has s^2 of it.
Eigen::MatrixXd prior_covariance(const Regressor& regressor, const BaseParameters& base);

/// The share s, 0.05 .. 10, of the prior under which estimates are the most probable that deviate from the model so and
/// have the covariance `of_data` (evidence, type-II maximum likelihood; MacKay 1992): what the data tell well says how
/// much the model is to be believed where they tell little. `of_prior`: covariance at s = 1. 0 where ten is still too
/// narrow.
double most_probable_prior(const Eigen::MatrixXd& of_data, const Eigen::MatrixXd& of_prior,
                           const Eigen::VectorXd& deviation);

}  // namespace tribotwin::twin
