#pragma once

#include <span>
#include <string>

#include <tribotwin/hil/canopen/dictionary.hpp>
#include <tribotwin/hil/drives/drive_parameters.hpp>

namespace tribotwin::hil {

/// A drive as EDS, DBC and the bus load describe it, without a simulation.
struct DescribedDrive {
  const Dictionary* dictionary;
  const DriveParameters* parameters;
};

/// A DBC file with all PDOs that exist, of all drives. Positions and speeds are scaled to the joint [rad, rad/s], as in
/// the telemetry; torques are those of the motor [Nm].
std::string dbc(std::span<const DescribedDrive> drives);

}  // namespace tribotwin::hil
