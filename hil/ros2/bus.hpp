#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/hil/canopen/dbc.hpp>

/// The drives as ros2_canopen (https://github.com/ros-industrial/ros2_canopen) is told of them: bus.yml, from which
/// its tool dcfgen (of Lely core) makes the configuration that the master writes into the drives at boot-up.
namespace tribotwin::hil {

/// Node number for the master: 127, or the lowest that no drive has; 0 when the drives have all.
int ros2_master_node(std::span<const DescribedDrive> drives);

/// Sets the PDOs in the dictionary as the configuration of bus.yml leaves them. All that the driver reads or writes
/// cyclically is mapped, with every SYNC: what it takes for mapped and is not would never arrive, and what it takes for
/// not mapped costs an SDO transfer in each cycle. Objects that this drive does not have are left out.
void map_for_ros2(Dictionary& dictionary);

/// The joints' names in ROS, in the order of the drives: letters, digits and underscores. "node1", ... for all where a
/// name is missing, given twice, or one that ros2_canopen keeps for itself.
std::vector<std::string> ros2_names(std::span<const DescribedDrive> drives);

/// Text of bus.yml for drives mapped by map_for_ros2. Positions, speeds and torques are those of the joint [rad, rad/s,
/// Nm]. cycle_us: period of SYNC [us].
std::string ros2_bus(std::span<const DescribedDrive> drives, std::uint32_t cycle_us);

}  // namespace tribotwin::hil
