#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/thermal/thermal.hpp>
#include <tribotwin/twin/identification/estimates.hpp>
#include <tribotwin/twin/identification/identifiability.hpp>
#include <tribotwin/twin/identification/thermal/thermal_recording.hpp>
#include <tribotwin/twin/identification/thermal/thermal_uncertainty.hpp>
#include <tribotwin/twin/numerics/correlated_noise.hpp>

/// A joint's thermal model from its heat and temperature: plugins/thermal's equation, Pagani (3),
///
///   T(t) = A + sum_i [ x_i0 exp(-t/t_i) + c_i t_i P_i(t) ],   t_i dP_i/dt = P - P_i,  P_i(0) = 0,
///
/// one node (first order: R_th = c_1 t_1, kappa = t_1) or two. A, per file, is the temperature without the recorded
/// power: ambient plus the effect of electronics that are always on. A and the x_i0, per session, are nuisances. All
/// but the t_i are linear: global search on a grid of time constants, then Ceres' trust region on the projected
/// residual. Gains are >= 0.
///
/// Sigmas count correlated residuals (numerics/correlated_noise.hpp) and the model's own error: one more node, slower
/// by what half to four times the record can show, is fitted beside, and an interval reaches as far as the parameter
/// moves with it. What then is no number is said by the rule of identification/identifiability.hpp.
namespace tribotwin::twin::identification {

/// Below this ratio of the time constants the fit has merged its two nodes, with gains of opposite sign.
constexpr double closest_ratio = 1.2;

struct ThermalOptions {
  thermal::Order order = thermal::Order::second;  ///< or first
  bool rested = false;  ///< every file begins at ambient temperature, as after a night: x_i0 = 0 in its first session
};

struct ThermalFit {
  std::vector<Estimate> parameters;  ///< thermal::parameters(order), the faster node first; held where the power has no
                                     ///< effect
  std::vector<Estimate> ambient;     ///< A [degC], per file
  thermal::Model model;              ///< with the mean of A
  double rms_K = 0;                  ///< of the residuals
  CorrelatedNoise noise = {};        ///< of the residuals [K]
  std::optional<ThermalUncertainty> uncertainty = {};  ///< none of torque, or with a number left free
  double correlation = 1;                              ///< number of correlated samples per independent one
  std::size_t samples = 0;
  std::vector<Lacking> lacking = {};             ///< what keeps parameters and T_amb from being numbers
  std::vector<std::string> unidentifiable = {};  ///< withheld(lacking)
};

/// The time constants [s] of a fit, the faster first.
std::span<const Estimate> time_constants(const ThermalFit& fit);

/// What the rule of identifiability needs beside the estimates of a thermal model.
Evidence thermal_evidence(std::span<const Estimate> parameters, thermal::Order order, double recorded_s);

/// What to record next for a thermal parameter, after `recorded_s`.
Advice thermal_advice(double recorded_s);

/// Why a parameter whose interval reaches that far by a slower body is no number.
std::string slower_body_reason(const Estimate& e, double recorded_s, double slower_s);

/// Both parameters of both nodes, where their time constants are within closest_ratio: the fit has merged them.
std::vector<Lacking> merged_nodes(std::span<const Estimate> parameters, thermal::Order order);

/// Every session has temperatures; the files are those of the sessions. ErrorKind::input with what the data lack.
Result<ThermalFit> fit_thermal(std::span<const HeatSession> sessions, const ThermalOptions& options = {});

/// Temperatures [degC] of a session from its first one, which is distributed over the nodes as after a long warm-up.
std::vector<double> predicted_temperature(const thermal::Model& model, const HeatSession& session);

}  // namespace tribotwin::twin::identification
