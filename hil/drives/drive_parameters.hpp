#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include <tribotwin/twin/control/servo.hpp>

namespace tribotwin::hil {

/// Parameters in which the drives on a bus differ. Motor side unless a line says otherwise.
struct DriveParameters {
  std::uint8_t node = 1;                               ///< node number, 1..127
  std::uint32_t serial_number = 0;                     ///< 1018h:04; 0: that of the node
  std::string name;                                    ///< of the joint
  double gear_ratio = 1;                               ///< motor turns per joint turn
  double rated_torque_nm = 1;                          ///< torque_max_nm / gear_ratio
  double speed_max_rad_s = 1000;                       ///< maximum motor speed
  std::uint32_t cycle_us = 2000;                       ///< SYNC period [us]
  bool limited = false;                                ///< whether the joint has the position limits:
  double position_low_rad = 0, position_high_rad = 0;  ///< joint side
  double start_degC = 25;                              ///< lubricant temperature at the start
  /// Of the winding, where the drive has one.
  struct Winding {
    double start_degC, warning_degC, limit_degC;
  };
  std::optional<Winding> winding{};
  /// Of the loops, where the scenario states none: six axes of an IRB 6620 follow 5 degrees at 0.5 Hz within 0.1.
  twin::LoopGains gains{.position_gain_1_s = 20, .speed_bandwidth_rad_s = 150, .integral_time_s = 0.02};
  double speed_bandwidth_max_rad_s = 1000;  ///< 1 / time step of the robot
};

}  // namespace tribotwin::hil
