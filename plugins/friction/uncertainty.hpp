#pragma once

#include <span>
#include <vector>

#include <tribotwin/plugins/friction/law.hpp>

namespace tribotwin::friction {

/// How sure a law is whose parameters have a covariance, for bands around its curves. Numbers without padding, because
/// pages carry them.
struct Uncertainty {
  /// The law with one parameter `step` larger, and smaller; step 0: the parameter is given.
  struct Change {
    GeneralLaw larger, smaller;
    double step = 0;  ///< [unit of the parameter]
  };
  double interval_sigmas = 1.96;  ///< half the width of an interval, in standard deviations
  Change changes[max_parameters];
  double covariance[max_parameters][max_parameters] = {};  ///< in the law's order; 0 of those that are given
};

/// `covariance`: a row per parameter of the law, in its order; rows and columns of 0 for parameters that are given.
Uncertainty make_uncertainty(const Law& law, std::span<const std::vector<double>> covariance, double interval_sigmas);

/// Half the width of the band around the friction level at |speed| [rad/s, the law's side], |load| [-] and a
/// temperature [degC], in the unit of the law: error propagation with central differences of the law as it is
/// evaluated, its validity policy included.
double half_width(const Law& law, const Uncertainty& uncertainty, double speed_rad_s, double load_norm,
                  double temperature_degC);

}  // namespace tribotwin::friction
