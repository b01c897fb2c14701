#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/estimates.hpp>
#include <tribotwin/twin/identification/identifiability.hpp>
#include <tribotwin/twin/identification/thermal/thermal_recording.hpp>
#include <tribotwin/twin/identification/thermal/thermal_uncertainty.hpp>

/// The joints of an arm as one chain of warm bodies: each is heated by its power, cools to its surroundings and
/// exchanges heat with the joints before and after it, at the same rate k everywhere (links of one kind),
///
///   dT_j/dt = g_j P_j + (A_j - T_j) / t_j + k (T_j-1 - T_j) + k (T_j+1 - T_j).
///
/// The slow poles, for which a record of a single joint is too short, are those of the chain and identifiable from the
/// temperatures of its neighbours. Every state is measured: a prediction needs only the first temperatures. A_j
/// includes the heat of electronics that are always on.
///
/// Where the power is the square of a motor's current, it can pass through windings first, which nobody measured: the
/// third node before gear and housing. A winding stores heat for `winding_s`, and its resistance grows with the
/// temperature of its joint, since its own rise above that is not known,
///
///   winding_s dw_j/dt = (1 + copper_1_K (T_j - 25 degC)) P_j - w_j,      with w_j in place of P_j above.
namespace tribotwin::twin::identification {

struct ChainWinding {
  double winding_s = 0;   ///< thermal time constant of the windings, one for all; 0: none
  double copper_1_K = 0;  ///< 0.00393 of copper
  bool operator==(const ChainWinding&) const = default;
};

/// What A_j can be: files with others are refused, and a fit keeps to them.
inline constexpr double lowest_ambient_degC = -273.15, highest_ambient_degC = 1000;

struct ThermalChain {
  std::vector<std::string> joints;
  std::vector<double> gain_K_J, t_s, ambient_degC;  ///< per joint: g_j, t_j, A_j
  double exchange_1_s = 0;                          ///< k
  ChainWinding winding = {};
};

struct ThermalChainFit {
  ThermalChain chain;
  std::vector<std::vector<Estimate>> parameters;  ///< per joint: gain, t, T_amb
  Estimate exchange;
  double rms_K = 0;        ///< of all residuals
  double correlation = 1;  ///< number of correlated samples per independent one
  std::size_t samples = 0;
  std::optional<ThermalUncertainty> uncertainty = {};  ///< none where a record leaves a number free
  std::vector<Lacking> lacking = {};                   ///< of exchange, JOINT.gain, JOINT.t and JOINT.T_amb
  std::vector<std::string> unidentifiable = {};        ///< withheld(lacking)
};

/// Joints in the order of the arm, all recorded at the same times. t_j and k by Ceres from several starts; the others
/// are linear, gains >= 0. A_j are the same in all sessions; one that ends at what it can be is at_bound.
/// ErrorKind::input with what the data lack.
Result<ThermalChainFit> fit_thermal_chain(std::span<const JointHeat> joints, ChainWinding winding = {});

/// A kind of winding and how well a chain with it, identified from the first two thirds of every session, predicts the
/// last third.
struct WindingTrial {
  ChainWinding winding;
  double held_out_rms_K = 0;  ///< of all joints
};
/// All kinds that are tried, none among them: time constants of 15 s to 8 min, copper. What is best is chosen without
/// any recording but these. Fails as fit_thermal_chain does.
Result<std::vector<WindingTrial>> try_windings(std::span<const JointHeat> joints);

/// As they stand in PARAMS.yaml: exchange, then gain, t and T_amb of each joint.
Eigen::VectorXd numbers_of(const ThermalChain& chain);

/// Temperatures [degC] of session `session`, joints x samples, from the first ones.
Eigen::MatrixXd predicted_temperatures(const ThermalChain& chain, std::span<const JointHeat> joints,
                                       std::size_t session);

}  // namespace tribotwin::twin::identification
