#pragma once

#include <tribotwin/hil/drives/bus_drive.hpp>

namespace tribotwin::hil {

/// Torque mode under a maximum speed. When the next step would be faster than that and the torque does not slow the
/// joint down, the speed loop takes over and holds the maximum, until the torque asks for less in this direction than
/// the loop does. Joint side.
struct SpeedLimitedTorque {
  double speed_rad_s = 0;  ///< of the last step; at the start that of the joint
  int limited_way = 0;     ///< direction in which the speed is limited instead of the torque; 0: none

  twin::DriveCommand command(double torque_nm, double speed_max_rad_s, const Feedback& feedback);
};

}  // namespace tribotwin::hil
