#pragma once

#include <cstdint>
#include <string>

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
};

}  // namespace tribotwin::hil
