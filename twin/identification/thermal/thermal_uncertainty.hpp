#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/numerics/correlated_noise.hpp>

/// What the fit of a thermal model leaves unknown of its predictions; thermal_band.hpp makes bands of it.
namespace tribotwin::twin::identification {

/// T_amb varies from day to day, by what the days of a fit show. One day shows nothing: the deviation begins as if
/// `supposed_days` had shown `supposed_K`.
struct Surroundings {
  static constexpr double supposed_K = 2, supposed_days = 5;
  std::size_t days = 1;             ///< recordings of the fit
  double deviation_K = supposed_K;  ///< standard deviation of a day's T_amb
  /// Of the T_amb of each recording [degC].
  static Surroundings of(std::span<const double> ambient_degC);
  /// Of a day's T_amb about that of the model, the mean of those of the fit [K^2]. `seen`: a day of the fit.
  double variance(bool seen) const;
};

/// Any number of warm bodies side by side, as in plugins/thermal, and their surroundings.
struct WarmBodies {
  std::vector<double> t_s, gain_K_J;
  double ambient_degC = 0;
};

/// What a fit leaves unknown of its predictions.
struct ThermalUncertainty {
  Eigen::MatrixXd covariance;  ///< of the numbers of PARAMS.yaml: thermal::values and T_amb; of a chain exchange, then
                               ///< gain, t and T_amb of each joint
  double sigmas = 1.96;        ///< half the width of a 95 % interval
  CorrelatedNoise noise;       ///< of recorded temperatures [K]
  Surroundings surroundings;
  std::vector<WarmBodies> slower;  ///< models with one more body that fit as well
};

/// Whether a covariance of these numbers can be counted with: a record that leaves one free, like T_amb where the power
/// never changes, gives variances that drown all others in rounding.
bool can_be_propagated(const Eigen::MatrixXd& covariance, const Eigen::VectorXd& numbers);

/// The mapping `uncertainty` of PARAMS.yaml, key and value.
void write(YAML::Emitter& out, const ThermalUncertainty& uncertainty);
/// Of a model with so many numbers. For readers: throws InputError.
ThermalUncertainty read_uncertainty(Mapping& in, Eigen::Index numbers);

}  // namespace tribotwin::twin::identification
