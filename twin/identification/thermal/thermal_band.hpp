#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/thermal/thermal.hpp>
#include <tribotwin/twin/identification/thermal/thermal_chain.hpp>
#include <tribotwin/twin/identification/thermal/thermal_recording.hpp>
#include <tribotwin/twin/identification/thermal/thermal_uncertainty.hpp>

/// How far recorded temperatures may lie from predicted ones. Of those of many days 95 % lie within
///
///   half^2 = sigmas^2 (g' C g + noise + surroundings + start) + slower^2
///
/// g, C    derivatives by the model's parameters and T_amb, and their covariance;
/// noise   of the first recorded temperature, from which a prediction begins, and of each later one;
/// surroundings   the T_amb of another day;
/// start   the first temperature may be that of one body or of the other: uniform between both;
/// slower  the largest difference to models with one more body, which the record could not exclude.
///
/// All but the last is linearised at the fit: a prediction much hotter or longer than the record is less sure than its
/// band.
namespace tribotwin::twin::identification {

/// Half the width [K] of the band around predicted_temperature, for each sample of the session, 0 at the first. `seen`:
/// the session is of the fit.
std::vector<double> half_width_K(const thermal::Model& model, const ThermalUncertainty& uncertainty,
                                 const HeatSession& session, bool seen);
/// The same around predicted_temperatures, joints x samples.
Eigen::MatrixXd half_widths_K(const ThermalChain& chain, const ThermalUncertainty& uncertainty,
                              std::span<const JointHeat> joints, std::size_t session, bool seen);

}  // namespace tribotwin::twin::identification
