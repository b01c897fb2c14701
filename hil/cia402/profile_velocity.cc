#include <algorithm>
#include <cmath>

#include <tribotwin/hil/cia402/modes.hpp>
#include <tribotwin/hil/cia402/words.hpp>

namespace tribotwin::hil::profile_velocity {
namespace {

double stop_rad(const MotionLimits& limits, const MotionState& state) {
  return speed_profile(limits, state, 0).end().position_rad;
}

/// Takes the motion to the limit when the next step towards `target` would be one too many to stop before it.
void watch_limits(Demand& d, const DriveObjects& o, MotionLimits limits, double target, double dt) {
  VelocityMove& move = d.turn;
  if (move.limit_way * target <= 0) move.limit_way = 0;
  if (move.limit_way != 0 || target == 0) return;
  const double limit = o.position_rad(target > 0 ? o.position_limit_high : o.position_limit_low);
  const int way = target > 0 ? 1 : -1;
  const auto beyond = [&](const MotionState& s) { return way * (stop_rad(limits, s) - limit) > 0; };
  if (!beyond(speed_profile(limits, d.motion, target).at(dt))) return;
  move.limit_way = way;
  move.time_s = 0;
  limits.speed_rad_s = std::min(limits.speed_rad_s, std::abs(target));
  move.stop = beyond(d.motion) ? speed_profile(limits, d.motion, 0) : position_profile(limits, d.motion, limit);
}

double seconds(const Object* milliseconds) { return 1e-3 * static_cast<double>(milliseconds->value); }

}  // namespace

twin::DriveCommand command(Demand& d, const DriveObjects& o, const Feedback& f, double dt) {
  const MotionLimits limits = o.profile_limits(o.profile_speed_max_rad_s());
  const double target = o.velocity_rad_s(o.target_velocity);
  d.motion.position_rad = f.position_rad;
  d.motion = within_speed(limits, d.motion);
  watch_limits(d, o, limits, target, dt);
  d.turn.time_s += dt;
  d.motion = d.turn.limit_way != 0 ? d.turn.stop.at(d.turn.time_s) : speed_profile(limits, d.motion, target).at(dt);
  d.position_rad = f.position_rad;
  return {.mode = twin::DriveCommand::Mode::velocity, .velocity_rad_s = d.motion.speed_rad_s};
}

void observe(Demand& d, const DriveObjects& o, const Feedback& f, double dt) {
  VelocityMove& move = d.turn;
  const double error = std::abs(f.velocity_rad_s - o.velocity_rad_s(o.target_velocity));
  const bool inside = error <= o.velocity_rad_s(o.velocity_window);
  move.in_window_s = inside ? move.in_window_s + dt : 0;
  move.reached = inside && move.in_window_s >= seconds(o.velocity_window_time);
  const bool moves = std::abs(f.velocity_rad_s) > o.velocity_rad_s(o.velocity_threshold);
  move.moving_s = moves ? move.moving_s + dt : 0;
  move.stands = !moves || move.moving_s < seconds(o.velocity_threshold_time);
}

int status(const Demand& d) {
  return (d.turn.reached ? target_reached : 0) | (d.turn.limit_way != 0 ? internal_limit_active : 0) |
         (d.turn.stands ? mode_bit_12 : 0);
}

}  // namespace tribotwin::hil::profile_velocity
