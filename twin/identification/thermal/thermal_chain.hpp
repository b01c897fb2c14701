#pragma once

#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/estimates.hpp>
#include <tribotwin/twin/identification/identifiability.hpp>
#include <tribotwin/twin/identification/thermal/thermal_recording.hpp>

/// The joints of an arm as one chain of warm bodies: each is heated by its power, cools to its surroundings and
/// exchanges heat with the joints before and after it, at the same rate k everywhere (links of one kind),
///
///   dT_j/dt = g_j P_j + (A_j - T_j) / t_j + k (T_j-1 - T_j) + k (T_j+1 - T_j).
///
/// The slow poles, for which a record of a single joint is too short, are those of the chain and identifiable from the
/// temperatures of its neighbours. Every state is measured: a prediction needs only the first temperatures. A_j
/// includes the heat of electronics that are always on.
namespace tribotwin::twin::identification {

struct ThermalChain {
  std::vector<std::string> joints;
  std::vector<double> gain_K_J, t_s, ambient_degC;  ///< per joint: g_j, t_j, A_j
  double exchange_1_s = 0;                          ///< k
};

struct ThermalChainFit {
  ThermalChain chain;
  std::vector<std::vector<Estimate>> parameters;  ///< per joint: gain, t, T_amb
  Estimate exchange;
  double rms_K = 0;        ///< of all residuals
  double correlation = 1;  ///< number of correlated samples per independent one
  std::size_t samples = 0;
  std::vector<Lacking> lacking = {};             ///< of exchange, JOINT.gain, JOINT.t and JOINT.T_amb
  std::vector<std::string> unidentifiable = {};  ///< withheld(lacking)
};

/// Joints in the order of the arm, all recorded at the same times. t_j and k by Ceres from several starts; the others
/// are linear, gains >= 0. A_j are the same in all sessions. ErrorKind::input with what the data lack.
Result<ThermalChainFit> fit_thermal_chain(std::span<const JointHeat> joints);

/// Temperatures [degC] of session `session`, joints x samples, from the first ones.
Eigen::MatrixXd predicted_temperatures(const ThermalChain& chain, std::span<const JointHeat> joints,
                                       std::size_t session);

}  // namespace tribotwin::twin::identification
