#pragma once

#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/thermal/thermal.hpp>
#include <tribotwin/twin/identification/curves/fit.hpp>
#include <tribotwin/twin/identification/thermal/thermal_recording.hpp>

/// A joint's thermal model from its heat and temperature: plugins/thermal's equation, P5 (3),
///
///   T(t) = A + sum_i [ x_i0 exp(-t/t_i) + c_i t_i P_i(t) ],   t_i dP_i/dt = P - P_i,  P_i(0) = 0,
///
/// one node (first order: R_th = c_1 t_1, kappa = t_1) or two. A, per file, is the temperature without the recorded
/// power: ambient and what electronics that are always on add to it. A and the x_i0, per session, are nuisances. All
/// but the t_i is linear: global search on a grid of time constants, then Ceres' trust region on the projected
/// residual. Gains are not negative. Sigmas: inverse information of all unknowns times the variance of the residuals
/// and the number of correlated samples that are worth one (numerics/correlation.hpp).
namespace tribotwin::twin::identification {

/// Time constants closer to each other than this ratio are one that the data describe badly: opposite, huge starts of
/// two like nodes.
constexpr double closest_ratio = 1.2;

struct ThermalOptions {
  thermal::Order order = thermal::Order::second;  ///< or first
  bool rested = false;  ///< every file begins at ambient temperature, as after a night: one session each, x_i0 = 0
};

struct ThermalFit {
  std::vector<Estimate>
      parameters;  ///< thermal::parameters(order); the faster node is the first. Held where the power has no effect
  std::vector<Estimate> ambient;  ///< A, per file
  thermal::Model model;           ///< with the mean of A
  double rms_K = 0;               ///< of the residuals
  double correlation = 1;         ///< how many correlated samples are worth one
  std::size_t samples = 0;
  std::vector<std::string> unidentifiable;  ///< parameters without a sigma or with a 95 % interval wider than their
                                            ///< value; all of them where both time constants are within closest_ratio
};

/// Fails with what the data lack; every session has temperatures. Files are those that the sessions name.
Result<ThermalFit> fit_thermal(std::span<const HeatSession> sessions, const ThermalOptions& options = {});

/// Temperatures [degC] of a session from its first one, which is taken to be on the nodes as a long warm-up would leave
/// it.
std::vector<double> predicted_temperature(const thermal::Model& model, const HeatSession& session);

}  // namespace tribotwin::twin::identification
