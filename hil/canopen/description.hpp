#pragma once

#include <span>
#include <string>

#include <tribotwin/hil/canopen/dictionary.hpp>

/// Files that describe drives to other tools, made from their dictionaries as they are now.
namespace tribotwin::hil {

/// Electronic data sheet of one drive (CiA 306).
std::string eds(const Dictionary& dictionary, const DriveParameters& parameters);

/// A DBC of all PDOs that exist, of all drives. Positions and speeds are scaled to the joint [rad, rad/s], so that they
/// are those of the telemetry; torques are those of the motor [Nm].
struct DescribedDrive {
  const Dictionary* dictionary;
  const DriveParameters* parameters;
};
std::string dbc(std::span<const DescribedDrive> drives);

}  // namespace tribotwin::hil
