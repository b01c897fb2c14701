#pragma once

#include <functional>
#include <limits>
#include <span>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/estimates.hpp>

/// Prediction error identification of what has a state of its own: the model is simulated along the recorded input, and
/// what it predicts is linear in some numbers, in others not. As in separable.hpp the linear ones follow from the
/// others (variable projection); those are searched on a grid over a thinned recording, the best starts descended there
/// by Ceres' trust region (derivatives of Kaufman 1975, from central differences of simulations), the deepest on all
/// samples.
namespace tribotwin::twin::identification {

/// prediction = known + basis * linear.
struct Prediction {
  Eigen::VectorXd known;
  Eigen::MatrixXd basis;
};

struct Simulated {
  Eigen::VectorXd measured;
  /// Called from several threads.
  std::function<Prediction(const Eigen::VectorXd& nonlinear)> predict;
  Eigen::VectorXd low, high;      ///< of the nonlinear numbers, which should be of the order of 1; equal: held
  std::vector<bool> linear_free;  ///< the others are 0
  double linear_low = -std::numeric_limits<double>::infinity();  ///< of a linear number that is the only one
  unsigned threads = 1;
};

struct Simulation {
  Eigen::VectorXd nonlinear, linear, residual;  ///< residual: measured - predicted
  double cost = std::numeric_limits<double>::infinity();
};

/// The best linear numbers for these nonlinear ones.
Simulation simulate(const Simulated& model, const Eigen::VectorXd& nonlinear);

/// The minimum on `all`. `few` is the same model on fewer samples.
Simulation search(const Simulated& few, const Simulated& all, const std::vector<Eigen::VectorXd>& starts);

/// What a minimum is worth. Numbers: the linear ones, then the nonlinear ones.
struct Uncertainty {
  Eigen::MatrixXd covariance;  ///< NaN where held, at a bound or dependent
  std::vector<Status> status;  ///< estimated, at_bound, or held: by the caller, or for the others can stand in for it
  double condition_number = 0;
  double correlated = 1;       ///< samples that are worth one independent
  std::vector<double> effect;  ///< root mean square of what one unit of the number does to the prediction
};
/// Variance of the residuals, times how many samples are worth one that is independent, times [sum psi psi^T]^-1.
Uncertainty uncertainty(const Simulated& model, const Simulation& minimum);

/// Completes `result`, whose parameters have values and statuses: their covariance is `to` times that of `worth`. A
/// number with a sigma above its place in `widest` is called unidentifiable. Statistics of the residuals and what they
/// say are added.
void conclude(const Simulated& model, const Simulation& minimum, const Uncertainty& worth, const Eigen::MatrixXd& to,
              std::span<const double> widest, Estimates& result);

}  // namespace tribotwin::twin::identification
