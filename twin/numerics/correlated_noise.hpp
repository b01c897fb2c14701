#pragma once

#include <span>
#include <vector>

#include <Eigen/Dense>

/// Errors of a fit along time: white noise, and a slow part (drift, surroundings, what the model does not know) whose
/// correlation decays exponentially,
///
///   cov(e_i, e_k) = white^2 [i = k] + slow^2 exp(-|t_i - t_k| / correlation_s)   within a series, 0 between two.
///
/// Found by restricted maximum likelihood (Patterson, Thompson 1971): unlike the autocorrelation of residuals it counts
/// what the fit itself has absorbed. White where the slow part does not raise the likelihood (Akaike's criterion).
namespace tribotwin::twin {

/// Samples in the order of time, in one or several series that do not correlate with each other.
struct SampleTimes {
  std::span<const double> time_s;
  std::vector<Eigen::Index> first{0};  ///< of each series
};

struct CorrelatedNoise {
  double white = 0, slow = 0;  ///< standard deviations
  double correlation_s = 0;    ///< of the slow part; 0 where there is none

  double variance() const { return white * white + slow * slow; }
  /// Number of samples, `step_s` apart, per independent one of the mean: 1 + 2 sum of the autocorrelations.
  double samples_per_independent(double step_s) const;
};

/// Of the residuals of a fit with this Jacobian (samples x parameters), more samples than parameters.
CorrelatedNoise correlated_noise(const Eigen::VectorXd& residual, const Eigen::MatrixXd& jacobian,
                                 const SampleTimes& times);

/// Covariance of the least-squares estimate under this noise, (J'J)^-1 J'VJ (J'J)^-1. Directions without information
/// get 1e30 times the variance of the noise.
Eigen::MatrixXd least_squares_covariance(const Eigen::MatrixXd& jacobian, const CorrelatedNoise& noise,
                                         const SampleTimes& times);

}  // namespace tribotwin::twin
