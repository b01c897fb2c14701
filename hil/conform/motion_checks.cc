#include <algorithm>
#include <cstdlib>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/conform/checks.hpp>

namespace tribotwin::hil {
namespace {

using S = DriveState;

constexpr std::uint16_t enable = 0x0F, new_set_point = 0x10, relative = 0x40;
constexpr int pp = 1, pv = 3, hm = 6, csp = 8, csv = 9, cst = 10;

constexpr od::Index profile_velocity = 0x6081, homing_method = 0x6098;

std::int64_t position(Device& d) { return d.get_signed(od::position_actual_value); }
std::int64_t velocity(Device& d) { return d.get_signed(od::velocity_actual_value); }

void needs_mode(Device& d, int mode, const char* name) {
  if (!d.supports(mode)) throw NotApplicable{fmt::format("6502h does not name {}", name)};
}

/// Mean of an actual value over 200 ms.
double mean(Device& d, std::uint16_t index) {
  double sum = 0;
  constexpr int samples = 10;
  for (int i = 0; i < samples; ++i) {
    sum += static_cast<double>(d.get_signed(index));
    d.bus.listen(20 * ms_ns);
  }
  return sum / samples;
}

bool near(double seen, double wanted, double share) { return std::abs(seen - wanted) <= share * std::abs(wanted); }

/// Mean speed, as soon as it is within 25 %, or after 2 s: static friction and a speed loop's integral take their time.
double mean_near(Device& d, double wanted) {
  double seen = 0;
  d.bus.until([&] { return near(seen = mean(d, od::velocity_actual_value), wanted, 0.25); }, 2000 * ms_ns);
  return seen;
}

// ---- Cyclic synchronous position.

/// Targets on a straight line, one per cycle.
void lead(Device& d, std::int64_t from, std::int64_t to) {
  constexpr int steps = 50;
  for (int i = 1; i <= steps; ++i) {
    d.put(od::target_position, 0, from + (to - from) * i / steps);
    d.bus.listen(cycle_ns);
  }
}

/// Friction may hold a soft position loop off its target.
std::int64_t near_enough(std::int64_t amplitude) { return std::max<std::int64_t>(1, amplitude / 6); }

std::string expect_position(Device& d, std::int64_t wanted, std::int64_t tolerance) {
  const bool there = d.bus.until([&] { return std::abs(position(d) - wanted) <= tolerance; }, 1500 * ms_ns);
  const std::string seen = fmt::format("6064h = {}", position(d));
  expect(there, fmt::format("6064h within {} of {}", tolerance, wanted), seen);
  return seen;
}

std::string csp_follows(Device& d) {
  needs_mode(d, csp, "CSP");
  const auto amplitude = d.amplitude();
  d.enable_in(csp);
  const auto start = position(d);
  lead(d, start, start + amplitude);
  const auto seen = expect_position(d, start + amplitude, near_enough(amplitude));
  lead(d, start + amplitude, start);
  expect_position(d, start, near_enough(amplitude));
  return fmt::format("{} of {}, and back", seen, start + amplitude);
}

std::string csp_status(Device& d) {
  needs_mode(d, csp, "CSP");
  d.enable_in(csp);
  d.bus.listen(100 * ms_ns);
  const auto word = d.status();
  const std::string seen = fmt::format("statusword {:04X}h", word);
  expect((word & 0x1000) && !(word & 0x2000), "bit 12 set, bit 13 clear", seen);
  return seen;
}

std::string csp_limit(Device& d) {
  needs_mode(d, csp, "CSP");
  d.needs(od::software_position_limit, 2);
  const auto amplitude = d.amplitude();
  d.enable_in(csp);
  const auto start = position(d), limit = start + amplitude / 2;
  if (d.refusal(od::software_position_limit, 2, limit)) throw NotApplicable{"607Dh:02 cannot be written"};
  lead(d, start, start + amplitude);
  d.bus.listen(200 * ms_ns);
  const auto seen = position(d);
  expect(seen <= limit + amplitude / 8, fmt::format("6064h up to 607Dh:02 = {}", limit), fmt::format("{}", seen));
  return fmt::format("6064h = {}, 607Dh:02 = {}", seen, limit);
}

/// A target position that the drive must not follow.
std::string expect_no_effect(Device& d, std::int64_t amplitude, std::int64_t wait_ns) {
  const auto start = position(d);
  d.put(od::target_position, 0, start + amplitude);
  d.bus.listen(wait_ns);
  const auto seen = position(d);
  expect(std::abs(seen - start) < amplitude / 4, fmt::format("6064h stays {}", start), fmt::format("{}", seen));
  return fmt::format("6064h = {}", seen);
}

std::string disabled_stands(Device& d) {
  needs_mode(d, csp, "CSP");
  const auto amplitude = d.amplitude();
  d.start_cycle();
  d.operational();
  d.set_mode(csp);
  d.bring_to(S::switched_on);
  return expect_no_effect(d, amplitude, 300 * ms_ns);
}

// ---- Cyclic synchronous velocity and torque.

std::string csv_follows(Device& d) {
  needs_mode(d, csv, "CSV");
  const auto speed = d.speed() * d.next_direction();
  d.enable_in(csv);
  d.put(od::target_velocity, 0, speed);
  const auto start = position(d);
  const double seen = mean_near(d, static_cast<double>(speed));
  const auto way = position(d) - start;
  d.put(od::target_velocity, 0, 0);
  const std::string text = fmt::format("606Ch = {:.0f}", seen);
  expect(near(seen, static_cast<double>(speed), 0.25), fmt::format("606Ch within 25 % of {}", speed), text);
  expect((way > 0) == (speed > 0) && way != 0, "6064h moves in this direction", fmt::format("by {}", way));
  const bool stands = d.bus.until([&] { return 5 * std::abs(velocity(d)) <= std::abs(speed); }, 1500 * ms_ns);
  expect(stands, "standstill with 60FFh = 0", fmt::format("606Ch = {}", velocity(d)));
  return text;
}

/// 6080h is in rpm.
std::string speed_limit(Device& d) {
  needs_mode(d, csv, "CSV");
  d.needs(od::max_motor_speed);
  d.needs(od::si_unit_velocity);
  if (d.options.speed) throw NotApplicable{"--speed does not tell rpm"};
  const auto speed = d.speed() * d.next_direction();
  d.enable_in(csv);
  if (d.refusal(od::max_motor_speed, 0, std::llround(default_speed_rpm / 2)))
    throw NotApplicable{"6080h cannot be written"};
  d.put(od::target_velocity, 0, speed);
  const double seen = mean_near(d, 0.5 * static_cast<double>(speed));
  const std::string text = fmt::format("606Ch = {:.0f}", seen);
  expect(near(seen, 0.5 * static_cast<double>(speed), 0.25), fmt::format("606Ch near {} by 6080h", speed / 2), text);
  return text;
}

/// Torque mode from standstill: from CSP where there is one, so that the target begins at what holds the load.
std::int64_t enter_torque_mode(Device& d) {
  needs_mode(d, cst, "CST");
  d.enable_in(d.supports(csp) ? csp : cst);
  d.bus.listen(200 * ms_ns);
  const auto holding = d.get_signed(od::torque_actual_value);
  d.put(od::target_torque, 0, holding);
  d.set_mode(cst);
  return holding;
}

std::string expect_torque(Device& d, std::int64_t wanted, const char* what) {
  d.bus.listen(50 * ms_ns);
  std::int64_t seen = 0;
  const bool there = d.bus.until(
      [&] {
        seen = d.get_signed(od::torque_actual_value);
        return std::abs(seen - wanted) <= std::max<std::int64_t>(5, d.torque() / 4);
      },
      150 * ms_ns);
  const std::string text = fmt::format("6077h = {}", seen);
  expect(there, fmt::format("6077h near {} ({})", wanted, what), text);
  return text;
}

std::string cst_follows(Device& d) {
  const auto wanted = enter_torque_mode(d) + d.torque() * d.next_direction();
  d.put(od::target_torque, 0, wanted);
  return expect_torque(d, wanted, "6071h");
}

std::string torque_limit(Device& d) {
  d.needs(od::max_torque);
  const auto holding = enter_torque_mode(d);
  const int direction = holding < 0 ? -1 : 1;
  const auto limit = std::abs(holding) + d.torque() / 2;
  if (d.refusal(od::max_torque, 0, limit)) throw NotApplicable{"6072h cannot be written"};
  d.put(od::target_torque, 0, direction * (limit + d.torque()));
  return expect_torque(d, direction * limit, "6072h");
}

// ---- Changes of the mode.

std::string switches_enabled(Device& d) {
  needs_mode(d, csp, "CSP");
  needs_mode(d, csv, "CSV");
  const auto amplitude = d.amplitude();
  d.enable_in(csp);
  const auto start = position(d);
  for (const int mode : {csv, csp, csv, csp}) {
    d.put(od::target_position, 0, position(d));
    d.put(od::target_velocity, 0, 0);
    d.set_mode(mode);
    d.bus.listen(100 * ms_ns);
    d.expect_state(S::operation_enabled);
  }
  const auto seen = position(d);
  expect(std::abs(seen - start) <= amplitude, fmt::format("6064h stays near {}", start), fmt::format("{}", seen));
  return fmt::format("operation enabled throughout, 6064h = {}", seen);
}

// ---- Profile modes.

bool bit(Device& d, std::uint16_t mask) { return d.status() & mask; }

void begin_pp(Device& d) {
  needs_mode(d, pp, "PP");
  d.enable_in(pp);
  if (d.has(profile_velocity)) d.refusal(profile_velocity, 0, d.speed());
}

/// The handshake: bit 4 of the controlword, bit 12 of the statusword.
void set_point(Device& d, std::int64_t target, std::uint16_t how) {
  d.put(od::target_position, 0, target);
  d.control(enable | how);
  d.control(static_cast<std::uint16_t>(enable | how | new_set_point));
  expect(d.bus.until([&] { return bit(d, 0x1000); }, 500 * ms_ns), "bit 12 of the statusword: set point taken",
         fmt::format("{:04X}h", d.status()));
  d.control(enable | how);
  expect(d.bus.until([&] { return !bit(d, 0x1000); }, 500 * ms_ns), "bit 12 clear after bit 4 is 0",
         fmt::format("{:04X}h", d.status()));
}

std::string expect_reached(Device& d, std::int64_t target, std::int64_t amplitude) {
  expect(d.bus.until([&] { return bit(d, 0x400); }, 5000 * ms_ns), "bit 10 of the statusword: target reached",
         fmt::format("{:04X}h, 6064h = {}", d.status(), position(d)));
  return expect_position(d, target, near_enough(amplitude));
}

std::string pp_absolute(Device& d) {
  needs_mode(d, pp, "PP");
  const auto amplitude = d.amplitude();
  begin_pp(d);
  const auto start = position(d);
  set_point(d, start + amplitude, 0);
  const auto seen = expect_reached(d, start + amplitude, amplitude);
  set_point(d, start, 0);
  expect_reached(d, start, amplitude);
  return seen + ", and back";
}

std::string pp_relative(Device& d) {
  needs_mode(d, pp, "PP");
  const auto amplitude = d.amplitude();
  begin_pp(d);
  const auto start = position(d);
  set_point(d, amplitude, relative);
  const auto seen = expect_reached(d, start + amplitude, amplitude);
  set_point(d, -amplitude, relative);
  expect_reached(d, start, amplitude);
  return seen + ", and back";
}

/// Without a rising edge of bit 4 a new target has no effect.
std::string pp_edge(Device& d) {
  needs_mode(d, pp, "PP");
  const auto amplitude = d.amplitude();
  begin_pp(d);
  return expect_no_effect(d, amplitude, 500 * ms_ns);
}

std::string pv_follows(Device& d) {
  needs_mode(d, pv, "PV");
  const auto speed = d.speed() * d.next_direction();
  d.enable_in(pv);
  d.put(od::target_velocity, 0, speed);
  const bool reached = d.bus.until(
      [&] { return bit(d, 0x400) && near(static_cast<double>(velocity(d)), static_cast<double>(speed), 0.25); },
      3000 * ms_ns);
  const std::string seen = fmt::format("606Ch = {}, statusword {:04X}h", velocity(d), d.status());
  d.put(od::target_velocity, 0, 0);
  expect(reached, fmt::format("606Ch within 25 % of {}, and bit 10", speed), seen);
  expect(d.bus.until([&] { return bit(d, 0x1000); }, 3000 * ms_ns), "bit 12 at standstill",
         fmt::format("{:04X}h", d.status()));
  return seen;
}

/// Methods 35 and 37: the present position becomes the home position.
std::string homing(Device& d) {
  needs_mode(d, hm, "HM");
  d.needs(homing_method);
  d.enable_in(hm);
  if (d.refusal(homing_method, 0, 37) && d.refusal(homing_method, 0, 35))
    throw NotApplicable{"6098h has neither 37 nor 35"};
  d.control(enable | new_set_point);
  const bool done = d.bus.until([&] { return (d.status() & 0x3400) == 0x1400; }, 3000 * ms_ns);
  const std::string seen = fmt::format("statusword {:04X}h", d.status());
  d.control(enable);
  expect(done, "bits 10 and 12 set, bit 13 clear", seen);
  return seen;
}

constexpr auto motion = Needs::motion;

constexpr Check checks[] = {
    {"csp.follows", "CiA 402-2, cyclic synchronous position", "6064h follows 607Ah.", motion, csp_follows},
    {"csp.status", "CiA 402-2, cyclic synchronous position", "Bit 12: follows the command; bit 13: no error.", motion,
     csp_status},
    {"csp.position_limit", "CiA 402-2, 607Dh", "The software position limit holds.", motion, csp_limit},
    {"csp.disabled", "CiA 402-2, PDS FSA", "In switched on a target does not move the drive.", motion, disabled_stands},
    {"csv.follows", "CiA 402-2, cyclic synchronous velocity", "606Ch follows 60FFh.", motion, csv_follows},
    {"csv.speed_limit", "CiA 402-2, 6080h", "The maximum motor speed holds.", motion, speed_limit},
    {"cst.follows", "CiA 402-2, cyclic synchronous torque", "6077h follows 6071h.", motion, cst_follows},
    {"cst.torque_limit", "CiA 402-2, 6072h", "The maximum torque holds.", motion, torque_limit},
    {"mode.switch_enabled", "CiA 402-2, 6060h, 6061h", "The mode can change in operation enabled.", motion,
     switches_enabled},
    {"pp.absolute", "CiA 402-2, profile position", "Set points by handshake; bit 10 when the target is reached.",
     motion, pp_absolute},
    {"pp.relative", "CiA 402-2, profile position", "Bit 6 of 6040h: the target is relative.", motion, pp_relative},
    {"pp.edge", "CiA 402-2, profile position", "Without the edge of bit 4 a target has no effect.", motion, pp_edge},
    {"pv.follows", "CiA 402-2, profile velocity", "606Ch follows 60FFh; bit 10 at speed, bit 12 at 0.", motion,
     pv_follows},
    {"hm.current_position", "CiA 402-2, homing, methods 35, 37", "Homing at the present position is attained.",
     Needs::homing, homing},
};

}  // namespace

Checks motion_checks() { return checks; }

}  // namespace tribotwin::hil
