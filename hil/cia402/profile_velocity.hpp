#pragma once

#include <tribotwin/hil/cia402/drive_objects.hpp>
#include <tribotwin/hil/drives/bus_drive.hpp>
#include <tribotwin/hil/motion/motion_profile.hpp>

/// Profile velocity (CiA 402-2, mode 3): the speed follows 60FFh along ramps, and stops at the position limits 607Dh,
/// for which it brakes in time. Bit 10 of the statusword: within 606Dh for 606Eh; bit 12: at most 606Fh.
namespace tribotwin::hil {

struct Demand;

/// Joint side.
struct VelocityMove {
  int limit_way = 0;                     ///< direction in which 607Dh ends the motion; 0: none
  MotionProfile stop;                    ///< to that limit
  double time_s = 0;                     ///< since `stop` began
  double in_window_s = 0, moving_s = 0;  ///< time for which the speed has been within 606Dh, and above 606Fh
  bool reached = false, stands = true;
};

namespace profile_velocity {

twin::DriveCommand command(Demand& demand, const DriveObjects& objects, const Feedback& feedback, double dt_s);
void observe(Demand& demand, const DriveObjects& objects, const Feedback& feedback, double dt_s);
int status(const Demand& demand);

}  // namespace profile_velocity
}  // namespace tribotwin::hil
