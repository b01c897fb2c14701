#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <tribotwin/hil/canopen/dictionary.hpp>
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

/// The SDO request that writes a value of at most 4 bytes (CiA 301, expedited download).
inline std::vector<std::uint8_t> download(std::uint16_t index, std::uint8_t sub, Type type, std::int64_t value) {
  std::vector<std::uint8_t> request{static_cast<std::uint8_t>(0x23 | (4 - size_of(type)) << 2),
                                    static_cast<std::uint8_t>(index),
                                    static_cast<std::uint8_t>(index >> 8),
                                    sub,
                                    0,
                                    0,
                                    0,
                                    0};
  encode(value, std::span(request).subspan(4, static_cast<std::size_t>(size_of(type))));
  return request;
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
