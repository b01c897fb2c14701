#pragma once

#include <functional>
#include <limits>
#include <span>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/identifiability.hpp>

/// Internal to this folder, not installed.
///
/// Prediction error identification of models with a state: the model is simulated along the recorded input; its
/// prediction is linear in some numbers and nonlinear in others. As in separable.hpp the linear numbers follow from the
/// nonlinear ones (variable projection). The nonlinear ones are searched on a grid over a thinned recording; the best
/// starts are descended there by Ceres' trust region (derivatives of Kaufman 1975, from central differences of
/// simulations), the deepest one on all samples.
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
  Eigen::VectorXd low, high;      ///< bounds of the nonlinear numbers, which should be of the order of 1; equal: fixed
  std::vector<bool> linear_free;  ///< the others are 0
  double linear_low = -std::numeric_limits<double>::infinity();  ///< bound of a linear number that is the only one
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

/// Uncertainty at a minimum. Numbers: the linear ones, then the nonlinear ones.
struct Uncertainty {
  Eigen::MatrixXd covariance;  ///< NaN where fixed, at a bound or dependent
  std::vector<Status>
      status;  ///< estimated, at_bound, or held: fixed by the caller or linearly dependent on the others
  double condition_number = 0;
  double correlated = 1;       ///< number of correlated samples per independent one
  std::vector<double> effect;  ///< root mean square change of the prediction per unit of the number
};
/// Covariance: variance of the residuals, times the correlated samples per independent one, times [sum psi psi^T]^-1.
Uncertainty uncertainty(const Simulated& model, const Simulation& minimum);

/// Completes `result`, whose parameters have values and statuses: their covariance is `to` times that of `uncertainty`
/// times its transpose; the rule of identifiability judges them, with scales and polynomials of `evidence`. Adds the
/// statistics of the residuals and notes about them.
void conclude(const Simulated& model, const Simulation& minimum, const Uncertainty& uncertainty,
              const Eigen::MatrixXd& to, Evidence evidence, const Advice& advice, Estimates& result);

}  // namespace tribotwin::twin::identification
