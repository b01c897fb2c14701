#pragma once

#include <optional>

#include <tribotwin/hil/cia402/drive_objects.hpp>
#include <tribotwin/hil/drives/bus_drive.hpp>
#include <tribotwin/hil/motion/motion_profile.hpp>

/// Profile position (CiA 402-2, mode 1): a set point is taken at a rising edge of bit 4 of the controlword with all
/// that belongs to it, and reached along ramps. Bit 12 of the statusword acknowledges it, until bit 4 falls and the
/// buffer is free again. One set point waits for the end of the one under way, unless bit 5 makes it effective at once;
/// with bit 6 its position counts from the set point before it.
namespace tribotwin::hil {

struct Demand;

/// The set points of a profile position move. Joint side.
struct PositionMove {
  struct SetPoint {
    double position_rad = 0, end_speed_rad_s = 0;
    MotionLimits limits;
    bool cut = false;  ///< its position was beyond 607Dh
  };
  SetPoint now;
  bool under_way = false;  ///< `now` is a set point of the master, and is not passed yet
  std::optional<SetPoint> waiting;
  MotionProfile profile;
  double time_s = 0;       ///< since the profile began
  double in_window_s = 0;  ///< time for which the position has been within 6067h of `now`
  double last_rad = 0;     ///< position of the last set point
  bool commanded = false;  ///< the master has given a set point since the drive entered the mode
  bool acknowledged = false, reached = false;
};

namespace profile_position {

/// Stops along 6084h.
void enter(Demand& demand, const DriveObjects& objects);
/// The controlword changed.
void control(Demand& demand, const DriveObjects& objects, std::int64_t before, std::int64_t now);
/// Continues after a halt, to where it was going before.
void resume(Demand& demand, const Demand& before, const DriveObjects& objects);
twin::DriveCommand command(Demand& demand, const DriveObjects& objects, const Feedback& feedback, double dt_s);
void observe(Demand& demand, const DriveObjects& objects, const Feedback& feedback, double dt_s);
int status(const Demand& demand);

}  // namespace profile_position
}  // namespace tribotwin::hil
