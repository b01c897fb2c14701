#pragma once

#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/thermal/thermal.hpp>
#include <tribotwin/twin/identification/curves/fit.hpp>
#include <tribotwin/twin/identification/thermal/thermal_recording.hpp>

/// A joint's thermal model from its heat and temperature: plugins/thermal's equation, Pagani (3),
///
///   T(t) = A + sum_i [ x_i0 exp(-t/t_i) + c_i t_i P_i(t) ],   t_i dP_i/dt = P - P_i,  P_i(0) = 0,
///
/// one node (first order: R_th = c_1 t_1, kappa = t_1) or two. A, per file, is the temperature without the recorded
/// power: ambient plus the effect of electronics that are always on. A and the x_i0, per session, are nuisances. All
/// but the t_i are linear: global search on a grid of time constants, then Ceres' trust region on the projected
/// residual. Gains are >= 0. Sigmas: inverse information of all unknowns times the variance of the residuals and the
/// number of correlated samples per independent one (numerics/correlation.hpp).
namespace tribotwin::twin::identification {

/// Below this ratio of the time constants the fit has merged its two nodes, with gains of opposite sign.
constexpr double closest_ratio = 1.2;

struct ThermalOptions {
  thermal::Order order = thermal::Order::second;  ///< or first
  bool rested = false;  ///< every file begins at ambient temperature, as after a night: one session per file, x_i0 = 0
};

struct ThermalFit {
  std::vector<Estimate> parameters;  ///< thermal::parameters(order), the faster node first; held where the power has no
                                     ///< effect
  std::vector<Estimate> ambient;     ///< A [degC], per file
  thermal::Model model;              ///< with the mean of A
  double rms_K = 0;                  ///< of the residuals
  double correlation = 1;            ///< number of correlated samples per independent one
  std::size_t samples = 0;
  std::vector<std::string> unidentifiable;  ///< names of parameters
};

/// The time constants [s] of a fit, the faster first.
std::span<const Estimate> time_constants(const ThermalFit& fit);

/// Parameters without a sigma or with a 95 % interval wider than their value; all where the time constants are within
/// closest_ratio.
std::vector<std::string> unidentifiable(std::span<const Estimate> parameters, thermal::Order order);

/// Every session has temperatures; the files are those of the sessions. ErrorKind::input with what the data lack.
Result<ThermalFit> fit_thermal(std::span<const HeatSession> sessions, const ThermalOptions& options = {});

/// Temperatures [degC] of a session from its first one, which is distributed over the nodes as after a long warm-up.
std::vector<double> predicted_temperature(const thermal::Model& model, const HeatSession& session);

}  // namespace tribotwin::twin::identification
