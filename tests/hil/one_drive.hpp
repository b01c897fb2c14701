#pragma once

#include <cstdint>
#include <vector>

#include <tribotwin/hil/drives/bus_drive.hpp>

/// A bus and a robot for drives without sockets and clocks.
namespace tribotwin::hil {

constexpr std::int64_t ms = 1'000'000;  ///< [ns]

/// A bus that takes every frame.
inline Send record_in(std::vector<Frame>& bus) {
  return [&bus](const Frame& frame) {
    bus.push_back(frame);
    return Sent::done;
  };
}

/// For 1 ms the robot does what the drive asks for.
inline void obey(BusDrive& drive, Feedback& robot) {
  using Mode = twin::DriveCommand::Mode;
  const auto c = drive.command(1e-3);
  if (c.mode == Mode::position)
    robot.position_rad = c.position_rad, robot.velocity_rad_s = c.velocity_rad_s;
  else if (c.mode == Mode::velocity)
    robot.velocity_rad_s = c.velocity_rad_s, robot.position_rad += 1e-3 * c.velocity_rad_s;
  else
    robot.velocity_rad_s = 0;
  robot.torque_nm = c.mode == Mode::torque ? c.torque_nm : 0;
  drive.feedback(robot, 1e-3);
}

}  // namespace tribotwin::hil
