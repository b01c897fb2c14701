#pragma once

#include <string>
#include <vector>

#include <tribotwin/twin/identification/drive_gains/drive_gains.hpp>

/// The efficiency of a transmission that friction in proportion to the load makes.
namespace tribotwin::twin::identification {

/// Of a load tau that the gear transmits [Nm; N] mu |tau| is lost, so that the motor gives (1 + mu) |tau| where it
/// drives the load and takes (1 - mu) |tau| where the load drives it. Friction without load is not part of it.
struct Efficiency {
  std::string joint;
  Estimate per_load;    ///< mu [-]: Fcl / torque_max of a law
  Estimate driving;     ///< 1 / (1 + mu)
  Estimate backdriven;  ///< 1 - mu; at most 0: the gear locks itself
};

/// Of every joint whose friction has a linear load term (coulomb_viscous_load, coulomb_viscous_load_stribeck) with a
/// sigma; none for other laws.
std::vector<Efficiency> transmission_efficiency(const RobotFriction& friction, const DynamicsFit& fit);

/// Of every joint with a drive gain: there other friction may change from time to time, as it does with the
/// temperature, which in a fit of recordings with different loads would count as load.
std::vector<Efficiency> transmission_efficiency(const DriveGains& gains);

}  // namespace tribotwin::twin::identification
