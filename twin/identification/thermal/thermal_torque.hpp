#pragma once

#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/thermal/thermal.hpp>
#include <tribotwin/twin/identification/thermal/thermal_fit.hpp>

/// A joint's thermal model without a thermometer: from how much less work a repeated cycle takes as it warms up, P5
/// (5), (6),
///
///   P(t) = P_0 (1 + sum_i y_i(t)),   dy_i/dt = alpha c_i P - y_i / t_i,   y_i = 0 at rest.
///
/// P is the mean friction power of a cycle: what says how warm the joint is, and what warms it. P_0, per recording, is
/// that of the cycle at the temperature of rest. Torque tells alpha c_i [1/J] and t_i, never alpha and c_i one by one:
/// that takes a temperature. Global search by CMA-ES, then Ceres. Sigmas as those of fit_thermal.
namespace tribotwin::twin::identification {

/// P / P_0 after `time_s` of a repeated cycle that takes `rest_power_w` at rest temperature, where friction changes by
/// `alpha` [1/K]. P5 (6), but for the heat: there it is the root mean square of a cycle's power and stays, here it is
/// the mean and follows the friction. Of first or second order; cycles are short beside the time constants.
double friction_share(const thermal::Model& model, double alpha, double rest_power_w, double time_s);

struct TorqueThermalFit {
  thermal::Order order = thermal::Order::second;
  std::vector<Estimate> parameters;  ///< alpha_c1, alpha_c2, t1, t2 or alpha_R_th, kappa; the faster node is the first
  std::vector<Estimate> power_w;     ///< P_0, per session
  double rms = 0;                    ///< of the residuals over P_0
  double final_to_cold = 1;          ///< least P_k / P_0 that the fit has in these recordings
  double correlation = 1;            ///< how many correlated samples are worth one
  std::size_t samples = 0;
  std::vector<std::string> unidentifiable;  ///< as in ThermalFit
};

/// Sessions have cycles, one kind in each that never pauses, and begin at rest temperature, as after a night: without
/// that a cold joint and a cycle that takes little work are the same. Fails with what the data lack.
Result<TorqueThermalFit> fit_thermal_torque(std::span<const HeatSession> sessions, thermal::Order order);

/// alpha [1/K] of P5 (5) where the temperature was recorded: P_k = P_0 (1 + alpha (T_k - rest_degC)), a straight line
/// per session with one alpha for all. Sessions have cycles and temperatures.
Estimate fit_alpha(std::span<const HeatSession> sessions, double rest_degC);

/// The same in kelvins, for friction that changes by `alpha` [1/K] of that at rest temperature, not 0. `alpha_known`:
/// else temperatures are in units of the guess and the gains are among the unidentifiable.
ThermalFit with_alpha(const TorqueThermalFit& fit, double alpha, bool alpha_known, double rest_degC);

}  // namespace tribotwin::twin::identification
