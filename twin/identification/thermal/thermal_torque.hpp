#pragma once

#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/thermal/thermal.hpp>
#include <tribotwin/twin/identification/thermal/thermal_fit.hpp>

/// A joint's thermal model without a temperature sensor: from the decrease of the work of a repeated cycle while the
/// joint warms up, Pagani (5), (6),
///
///   P(t) = P_0 (1 + sum_i y_i(t)),   dy_i/dt = alpha c_i P - y_i / t_i,   y_i = 0 at rest.
///
/// P is the mean friction power of a cycle, which both measures and causes the temperature. P_0, per recording, is that
/// of the cycle at rest temperature. Torque identifies alpha c_i [1/J] and t_i; alpha and c_i separately need a
/// temperature. Global search by CMA-ES, then Ceres. Sigmas as those of fit_thermal; a
/// slower body is tried beside the first order only.
namespace tribotwin::twin::identification {

/// P / P_0 after `time_s` of a repeated cycle with the power `rest_power_w` at rest temperature; friction changes by
/// `alpha` [1/K]. Pagani (6), except for the heat: there the constant root mean square of a cycle's power, here the
/// mean, which follows the friction. First or second order; cycles are short compared to the time constants.
double friction_share(const thermal::Model& model, double alpha, double rest_power_w, double time_s);

struct TorqueThermalFit {
  thermal::Order order = thermal::Order::second;
  std::vector<Estimate> parameters;  ///< alpha_c1, alpha_c2, t1, t2 or alpha_R_th, kappa; the faster node first
  std::vector<Estimate> power_w;     ///< P_0, per session
  double rms = 0;                    ///< of the residuals over P_0
  double final_to_cold = 1;          ///< minimum P_k / P_0 of the fit in these recordings
  double correlation = 1;            ///< number of correlated samples per independent one
  std::size_t samples = 0;
  std::vector<Lacking> lacking = {};             ///< as in ThermalFit
  std::vector<std::string> unidentifiable = {};  ///< withheld(lacking)
};

/// Sessions have cycles, one kind in each without a pause, and begin at rest temperature, as after a night: otherwise a
/// cold joint and a cycle of little work are indistinguishable. ErrorKind::input with what the data lack.
Result<TorqueThermalFit> fit_thermal_torque(std::span<const HeatSession> sessions, thermal::Order order);

/// alpha [1/K] of Pagani (5) where the temperature was recorded: P_k = P_0 (1 + alpha (T_k - rest_degC)), a straight
/// line per session with a common alpha. Sessions have cycles and temperatures.
Estimate fit_alpha(std::span<const HeatSession> sessions, double rest_degC);

/// The fit in kelvins, for friction that changes by `alpha` [1/K], not 0, of that at rest temperature. Where alpha is
/// not known, temperatures are in units of the guess and the gains are unidentifiable.
ThermalFit with_alpha(const TorqueThermalFit& fit, double alpha, bool alpha_known, double rest_degC);

}  // namespace tribotwin::twin::identification
