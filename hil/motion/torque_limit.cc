#include <cmath>

#include <tribotwin/hil/motion/torque_limit.hpp>

namespace tribotwin::hil {

twin::DriveCommand SpeedLimitedTorque::command(double torque_nm, double speed_max_rad_s, const Feedback& feedback) {
  using Mode = twin::DriveCommand::Mode;
  const double speed = feedback.velocity_rad_s, next = 2 * speed - speed_rad_s;
  const bool slows_down = torque_nm * next < 0 && std::abs(next) <= std::abs(speed);
  speed_rad_s = speed;
  if (limited_way != 0 && limited_way * (torque_nm - feedback.torque_nm) < 0)
    limited_way = 0;
  else if (limited_way == 0 && std::abs(next) > speed_max_rad_s && !slows_down)
    limited_way = next > 0 ? 1 : -1;
  if (limited_way == 0) return {.mode = Mode::torque, .torque_nm = torque_nm};
  return {.mode = Mode::velocity, .velocity_rad_s = limited_way * speed_max_rad_s};
}

}  // namespace tribotwin::hil
