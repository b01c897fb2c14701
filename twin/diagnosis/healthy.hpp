#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/diagnosis/observation.hpp>

/// The normal friction of one joint, learned from unloaded curves cold to hot, in two descriptions.
///
/// Zhou 2024's: mean mu and covariance Sigma of Fc, Fs, Vs (region 1) and Fv, beta (region 2) over all temperatures,
/// squared distance (y - mu)' Sigma^-1 (y - mu) (15) against N^2 (chi-square), ellipsoid radii N sqrt(lambda) (14).
///
/// The baseline, by which anomalies are judged: logarithmic features y = B'x + e, x = (1, T - T_reference), e normal
/// with covariance v S, v the scatter that each fit claims for itself (Observation::shape). For a new healthy
/// observation T^2 = (y - B'x)' S^-1 (y - B'x) / (v + x' (X'WX)^-1 x) is p nu / (nu - p + 1) times an F(p, nu - p + 1)
/// variate, nu = n - q (Anderson 2003, 8.4); for x = 1 this is Hotelling's prediction limit p (n^2 - 1) / (n (n - p))
/// F. So the false-alarm rate is the requested one at every temperature and for any number of learned observations.
/// Zhou 2024's distance of the coldest and hottest observations is mostly an effect of temperature.
namespace tribotwin::twin::diagnosis {

/// Probability of a normal variate beyond 2 standard deviations: the default rate at which healthy joints are called
/// anomalous, per region. Zhou 2024's N^2 = 4 has 26 % in region 1 and 13.5 % in region 2.
constexpr double two_sigma_false_alarm = 0.0455;
constexpr std::size_t observations_minimum = 8, observations_usual = 20;
constexpr double temperature_span_K = 5;  ///< in a smaller range the temperature term would follow noise

/// Multivariate regression of p numbers on q = 1 or 2 regressors.
struct Baseline {
  Eigen::MatrixXd coefficients;  ///< q x p
  Eigen::MatrixXd covariance;    ///< p x p, of an observation with scatter 1
  Eigen::MatrixXd inverse_gram;  ///< q x q, (X'WX)^-1
  double freedom = 0;            ///< nu

  Eigen::VectorXd predicted(const Eigen::VectorXd& x) const { return coefficients.transpose() * x; }
  /// Variance factor of observed - predicted, for an observation of this scatter.
  double variance(const Eigen::VectorXd& x, double scatter) const { return scatter + x.dot(inverse_gram * x); }
  /// T^2 that a healthy observation exceeds with this probability, and its inverse.
  double limit(double false_alarm) const;
  double exceeded_by_chance(double statistic) const;
};

/// Least squares of y (n x p) on x (n x q), rows weighted by 1 / scatter; n > q.
Baseline regression(const Eigen::MatrixXd& x, const Eigen::MatrixXd& y, const Eigen::VectorXd& scatter);

/// Scatter of a fit in a region from the covariance that it claims (Observation::shape); 0 where it claims none.
double shape_scatter(const FeatureMatrix& shape, const RegionFeatures& region);

struct HealthyState {
  std::string joint;         ///< empty: not known
  double torque_max_nm = 0;  ///< 0: not known
  std::size_t observations = 0;
  std::size_t left_out = 0;  ///< by the robust estimate
  double temperature_low_degC = 0, temperature_high_degC = 0;
  bool knows_temperature = false;  ///< whether the baseline has a temperature term
  double load_sensitivity = 0;     ///< as in ObservationOptions

  double anomalous_distance = 4, wear_distance = 36;  ///< N^2 of Zhou 2024, 2 and 6 sigma
  Features mean = Features::Zero();                   ///< Zhou 2024, in feature_units
  FeatureMatrix covariance = FeatureMatrix::Zero();

  std::array<Baseline, 2> region;                      ///< of the logarithmic features
  std::array<double, 2> scatter{1, 1};                 ///< of a typical fit: the unit of scatter_of
  FeatureMatrix together = FeatureMatrix::Identity();  ///< covariance of both regions for observations of scatter 1,
                                                       ///< shrunk towards the one that the fits claim
  double shrinkage = 0;                                ///< 0: the sample covariance, 1: the target

  struct IndicatorState {
    double mean = 0, deviation = 0;
  };
  std::array<std::optional<IndicatorState>, indicator_count> indicators;

  Features load_effect = Features::Zero();  ///< change of ln Fc, ln Fs, ln Vs, ln Fv, beta per load_term
  bool load_measured = false;               ///< with loaded curves; otherwise load_effect follows from load_sensitivity
  double lever_m = 0;                       ///< of the payload about the joint, for loads in kg; 0: not known
  std::vector<std::string> data;            ///< files

  Eigen::VectorXd regressors(std::optional<double> temperature_degC) const;
  double temperature_reference_degC() const { return (temperature_low_degC + temperature_high_degC) / 2; }
  double degrees_of_freedom() const { return region[0].freedom; }
  /// Scatter of an observation in a region, 1 for a typical one.
  double scatter_of(const Observation& o, std::size_t which) const;
  /// Logarithmic features minus those of a healthy joint at this temperature.
  Features deviation(const Observation& o) const;
  /// Whether its temperature is beyond the learned ones by more than 2 K.
  bool extrapolates(const Observation& o) const;
  /// Zhou 2024 (15), squared, and the radii of (14) for N = 1, ascending.
  double distance(const Features& features, std::size_t which) const;
  Eigen::VectorXd radii(std::size_t which) const;
  /// load_sensitivity relative to the friction at the healthy load.
  double sensitivity_at_mean_load() const;
  /// ln(1 + k extra) / k, in which logarithmic features are linear (extra: load_norm beyond the healthy one), and its
  /// inverse.
  double load_term(double extra) const;
  double load_of_term(double term) const;
  /// Extra load (load_norm) at which Zhou 2024's distance in region 1 reaches the wear threshold.
  double wear_load() const;
};

}  // namespace tribotwin::twin::diagnosis
