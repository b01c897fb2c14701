#pragma once

#include <string>
#include <vector>

#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>

/// The efficiency of a transmission that friction in proportion to the load makes.
namespace tribotwin::twin::identification {

/// Of a load tau that the gear transmits [Nm; N] mu |tau| is lost, so that the motor gives (1 + mu) |tau| where it
/// drives the load and takes (1 - mu) |tau| where the load drives it. Friction without load is not part of it.
struct Efficiency {
  std::string joint;
  Estimate per_load;    ///< mu [-], Fcl / torque_max
  Estimate driving;     ///< 1 / (1 + mu)
  Estimate backdriven;  ///< 1 - mu; at most 0: the gear locks itself
};

/// Of every joint whose friction has a linear load term (coulomb_viscous_load, coulomb_viscous_load_stribeck) with a
/// sigma; none for other laws.
std::vector<Efficiency> transmission_efficiency(const RobotFriction& friction, const DynamicsFit& fit);

}  // namespace tribotwin::twin::identification
