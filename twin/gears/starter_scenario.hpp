#pragma once

#include <string>

#include <tribotwin/twin/gears/add_drives.hpp>

/// A first hour of work for a robot that has just got its drives.
namespace tribotwin::twin {

/// YAML for `tribotwin run`: all drives go back and forth between two poses, multi-rate. The poses lie within the joint
/// ranges, without contacts that the middle pose does not have, and gravity, friction and acceleration need at most
/// 70 % of the torque that each drive can give. `model` is written as the key `model`. ErrorKind::work where there is
/// no such motion: the message says which joint lacks what.
Result<std::string> starter_scenario(const RobotWithDrives& robot, const std::string& model);

}  // namespace tribotwin::twin
