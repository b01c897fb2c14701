#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/hil/canopen/dbc.hpp>

namespace tribotwin::hil {

/// How a folder with bus.yml and EDS files is used: as Markdown.
struct Ros2Readme {
  std::string folder;                  ///< its name, from which those of a ROS package and its configuration are made
  std::vector<std::string> arguments;  ///< of `tribotwin-hil drive` for these drives
  std::string bus_load;                ///< one sentence
  std::uint32_t cycle_us;              ///< period of SYNC [us]
};
std::string ros2_readme(std::span<const DescribedDrive> drives, const Ros2Readme& readme);

}  // namespace tribotwin::hil
