#include <algorithm>
#include <cmath>
#include <utility>

#include <tribotwin/hil/cia402/modes.hpp>
#include <tribotwin/hil/cia402/words.hpp>

namespace tribotwin::hil::profile_position {
namespace {

using SetPoint = PositionMove::SetPoint;

double profile_speed(const DriveObjects& o) {
  return std::min(o.velocity_rad_s(o.profile_velocity), o.profile_speed_max_rad_s());
}

SetPoint read_set_point(const PositionMove& move, const DriveObjects& o, bool relative_to_last) {
  const double asked = o.position_rad(o.target_position) + (relative_to_last ? move.last_rad : 0);
  const double position = o.within_position_limits(asked);
  const MotionLimits limits = o.profile_limits(profile_speed(o));
  const double room =
      std::min(position - o.position_rad(o.position_limit_low), o.position_rad(o.position_limit_high) - position);
  const double end_speed = o.velocity_rad_s(o.end_velocity);
  return {.position_rad = position,
          // No set point may follow, and then the way of the stop counts against 607Dh, too.
          .end_speed_rad_s = end_speed > 0 ? std::min(end_speed, speed_to_stop_within(limits, room)) : 0,
          .limits = limits,
          .cut = position != asked};
}

void plan(Demand& d) {
  PositionMove& move = d.move;
  d.motion = within_speed(move.now.limits, d.motion);
  move.profile = position_profile(move.now.limits, d.motion, move.now.position_rad, move.now.end_speed_rad_s);
  move.time_s = 0;
}

void start(Demand& d, const SetPoint& set_point) {
  d.move.now = set_point;
  d.move.under_way = true;
  d.move.reached = false;
  d.move.in_window_s = 0;
  plan(d);
}

bool arrived(const PositionMove& move) { return move.time_s >= move.profile.duration_s(); }

/// At the end of a profile: the set point that waits, from the speed of the last one; without it an end speed is
/// stopped, for a drive must not run away. False: it stands.
bool go_on(Demand& d, const DriveObjects& o) {
  PositionMove& move = d.move;
  const double late = move.time_s - move.profile.duration_s();
  const double end_speed = move.profile.end().speed_rad_s;
  if (!move.waiting && end_speed == 0) return false;
  d.motion = move.profile.end();
  if (move.waiting) {
    SetPoint next = *std::exchange(move.waiting, std::nullopt);
    next.limits.speed_rad_s = std::min(next.limits.speed_rad_s, o.profile_speed_max_rad_s());  // lowered meanwhile
    start(d, next);
  } else {
    move.under_way = false;
    move.reached = true;
    move.profile = speed_profile(move.now.limits, d.motion, 0);
  }
  move.time_s = late;
  return true;
}

void release_acknowledge(PositionMove& move, std::int64_t controlword) {
  if (!(controlword & operation_specific) && !move.waiting) move.acknowledged = false;
}

}  // namespace

void enter(Demand& d, const DriveObjects& o) {
  const MotionLimits limits = o.profile_limits(profile_speed(o));
  d.move = {.now = {.limits = limits}, .profile = speed_profile(limits, d.motion, 0)};
  d.move.now.position_rad = d.move.last_rad = d.move.profile.end().position_rad;
}

void control(Demand& d, const DriveObjects& o, std::int64_t before, std::int64_t now) {
  PositionMove& move = d.move;
  const bool immediately = now & change_immediately;
  if ((now & ~before & operation_specific) && (immediately || !move.waiting)) {
    const SetPoint set_point = read_set_point(move, o, now & relative);
    move.last_rad = set_point.position_rad;
    move.acknowledged = move.commanded = true;
    if (immediately || arrived(move) || move.reached) {
      move.waiting.reset();
      start(d, set_point);
    } else {
      move.waiting = set_point;
    }
  }
  release_acknowledge(move, now);
}

void resume(Demand& d, const Demand& before, const DriveObjects& o) {
  const PositionMove& halted = before.move;
  if (halted.under_way) {
    d.move = halted;
    return plan(d);
  }
  enter(d, o);  // it was stopping: a set point still waits for that, and the next one may count from it
  d.move.waiting = halted.waiting;
  d.move.now.cut = halted.now.cut;
  d.move.acknowledged = halted.acknowledged;
  d.move.commanded = halted.commanded;
  if (halted.commanded) d.move.last_rad = halted.last_rad;
}

twin::DriveCommand command(Demand& d, const DriveObjects& o, const Feedback&, double dt) {
  PositionMove& move = d.move;
  if (const double most = o.profile_speed_max_rad_s(); most < move.now.limits.speed_rad_s && !arrived(move)) {
    move.now.limits.speed_rad_s = most;  // 607Fh or 6080h was lowered on the way
    if (move.under_way) plan(d);
  }
  move.time_s += dt;
  while (arrived(move) && go_on(d, o)) continue;  // a short way may end within the step, too
  release_acknowledge(move, o.controlword->value);
  d.motion = move.profile.at(move.time_s);
  d.position_rad = d.motion.position_rad;
  return {.mode = twin::DriveCommand::Mode::position,
          .position_rad = d.motion.position_rad,
          .velocity_rad_s = d.motion.speed_rad_s};
}

/// Within 6067h of the set point for 6068h.
void observe(Demand& d, const DriveObjects& o, const Feedback& f, double dt) {
  PositionMove& move = d.move;
  if (!move.under_way && move.reached) return;  // passed with its end speed
  const auto window = o.position_window->value;
  const bool inside = window == DriveObjects::window_off
                          ? arrived(move)
                          : std::abs(f.position_rad - move.now.position_rad) <= o.position_rad(window);
  move.in_window_s = inside ? move.in_window_s + dt : 0;
  move.reached = inside && move.in_window_s >= 1e-3 * static_cast<double>(o.position_window_time->value);
}

int status(const Demand& d) {
  const PositionMove& move = d.move;
  return (move.reached && !move.waiting ? target_reached : 0) | (move.now.cut ? internal_limit_active : 0) |
         (move.acknowledged ? mode_bit_12 : 0) | (d.lags ? mode_bit_13 : 0);
}

}  // namespace tribotwin::hil::profile_position
