#include <algorithm>
#include <cmath>

#include <tribotwin/hil/cia402/cyclic_modes.hpp>
#include <tribotwin/hil/cia402/words.hpp>

namespace tribotwin::hil::cyclic {

using twin::DriveCommand;

namespace {

/// A straight line to a target over the interpolation time 60C2h, within 607Dh and 6080h.
void draw_line(Demand& demand, const DriveObjects& o, const Object* position) {
  const double target_rad = o.within_position_limits(o.position_rad(position));
  const double speed_max = o.speed_max_rad_s();
  demand.left_s = o.interpolation_s();
  demand.step_rad_s = std::clamp((target_rad - demand.position_rad) / demand.left_s, -speed_max, speed_max);
}

/// The next step on the line; at its end it stands.
DriveCommand follow_line(Demand& demand, double dt) {
  const double step = std::min(dt, demand.left_s);
  demand.position_rad += demand.step_rad_s * step;
  const double speed = demand.left_s > 0 ? demand.step_rad_s : 0;
  demand.left_s = std::max(0.0, demand.left_s - dt);
  return {.mode = DriveCommand::Mode::position, .position_rad = demand.position_rad, .velocity_rad_s = speed};
}

}  // namespace

/// Cyclic synchronous position (CiA 402-2).
void csp_target(Demand& demand, const DriveObjects& o) { draw_line(demand, o, o.target_position); }

DriveCommand csp(Demand& demand, const DriveObjects& o, const Feedback&, double dt) {
  DriveCommand c = follow_line(demand, dt);
  c.velocity_rad_s += o.velocity_rad_s(o.velocity_offset);
  c.torque_nm = o.torque_nm(o.torque_offset);
  return c;
}

/// Cyclic synchronous velocity (CiA 402-2): stops at the position limits 607Dh.
DriveCommand csv(Demand&, const DriveObjects& o, const Feedback& feedback, double) {
  DriveCommand c{.mode = DriveCommand::Mode::velocity};
  const double speed_max = o.speed_max_rad_s();
  double speed =
      std::clamp(o.velocity_rad_s(o.target_velocity) + o.velocity_rad_s(o.velocity_offset), -speed_max, speed_max);
  const double low = o.position_rad(o.position_limit_low), high = o.position_rad(o.position_limit_high);
  if ((feedback.position_rad >= high && speed > 0) || (feedback.position_rad <= low && speed < 0)) speed = 0;
  c.velocity_rad_s = speed;
  c.torque_nm = o.torque_nm(o.torque_offset);
  return c;
}

/// Cyclic synchronous torque (CiA 402-2), under the maximum speed 6080h.
DriveCommand cst(Demand& demand, const DriveObjects& o, const Feedback& feedback, double) {
  return demand.torque.command(o.torque_nm(o.target_torque) + o.torque_nm(o.torque_offset), o.speed_max_rad_s(),
                               feedback);
}

/// Bit 12: the drive follows its set points; 13: not closely; 11: 6080h limits the speed instead of the torque.
int status(const Demand& demand) {
  return (demand.halted ? 0 : mode_bit_12) | (demand.lags ? mode_bit_13 : 0) |
         (!demand.halted && demand.torque.limited_way != 0 ? internal_limit_active : 0);
}

// ---- Interpolated position (CiA 402-2, mode 7).

void ip_enter(Demand& demand, const DriveObjects&) { demand.idle = true; }

void ip_resume(Demand& demand, const Demand& before, const DriveObjects&) { demand.idle = before.idle; }

void ip_control(Demand& demand, const DriveObjects& o, std::int64_t before, std::int64_t now) {
  demand.idle = !(now & operation_specific);
  // The position that is there already is the first one: it may have come with this bit.
  if (now & ~before & operation_specific) ip_target(demand, o);
}

void ip_target(Demand& demand, const DriveObjects& o) {
  if (!demand.idle) draw_line(demand, o, o.interpolated_position);
}

DriveCommand ip(Demand& demand, const DriveObjects& o, const Feedback&, double dt) {
  DriveCommand c{.mode = DriveCommand::Mode::position};
  if (demand.idle) {
    demand.motion = speed_profile(o.profile_limits(o.speed_max_rad_s()), demand.motion, 0).at(dt);
    demand.position_rad = c.position_rad = demand.motion.position_rad;
    c.velocity_rad_s = demand.motion.speed_rad_s;
  } else {
    c = follow_line(demand, dt);
    demand.motion = {c.position_rad, c.velocity_rad_s, 0};
  }
  return c;
}

/// Bit 12: interpolation is active.
int ip_status(const Demand& demand) { return demand.idle || demand.halted ? 0 : mode_bit_12; }

}  // namespace tribotwin::hil::cyclic
