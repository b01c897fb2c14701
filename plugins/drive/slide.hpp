#pragma once

#include <tribotwin/plugins/drive/drive.hpp>

/// A drive whose motion and load are known instead of simulated: on a test bench, in a controller, in another program.
/// There is no constraint that decides whether the joint sticks, so friction is that of sliding at the given speed.
namespace tribotwin::drive {

/// All that such a drive carries from step to step. All zero: ambient temperature, angle 0, healthy.
struct Sliding {
  MotorState state;
  Workspace workspace{};
  double time_s = 0, position_rad = 0;
};

/// The largest inputs that count; others, and those that are not finite, count as 0 and as outside.
inline constexpr double slide_speed_max_rad_s = 1e6, slide_load_max_nm = 1e12, slide_dt_max_s = 1e6;

/// Slides for dt_s at a constant joint speed, while the gear transmits load_nm to the arm, and returns the friction of
/// the gear [Nm, arm side, positive with motion, without Drive::offset_nm]. At speed 0 that of the bristles, or 0;
/// `workspace.limit_nm` has what holds. Heat and temperature advance by the step. A dt_s that is not above 0 advances
/// nothing. `decay` is that of dt_s. A winding heats by the current that load, friction and offset need, at most by
/// `workspace.current_limit_A`: where they need more, the drive would not keep up this motion.
double slide(const Drive& drive, const thermal::Decay& decay, double speed_rad_s, double load_nm, Sliding& sliding);

}  // namespace tribotwin::drive
