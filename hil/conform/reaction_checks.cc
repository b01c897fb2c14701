#include <algorithm>
#include <cstdlib>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/conform/checks.hpp>

namespace tribotwin::hil {
namespace {

using S = DriveState;

/// Against static friction the integral of a speed loop needs some time.
constexpr std::int64_t longest_start_ns = 2000 * ms_ns;
constexpr std::int64_t longest_stop_ns = 3000 * ms_ns;
constexpr std::uint16_t enable = 0x0F, halt = 0x100, target_reached = 0x400;

std::int64_t velocity(Device& d) { return d.get_signed(od::velocity_actual_value); }

/// At least at half the speed, in its direction.
bool runs_at(std::int64_t seen, std::int64_t speed) { return seen * (speed > 0 ? 2 : -2) > std::abs(speed); }

/// The drive runs at a low speed in CSV; without CSV it stands, enabled.
void run(Device& d) {
  if (!d.supports(9)) return d.enable_in(d.any_mode());
  const auto speed = d.speed() * d.next_direction();
  d.enable_in(9);
  d.put(od::target_velocity, 0, speed);
  const bool runs = d.bus.until([&] { return runs_at(velocity(d), speed); }, longest_start_ns);
  expect(runs, fmt::format("606Ch near 60FFh = {}", speed), fmt::format("{}", velocity(d)));
}

/// Within the time that a stop may take.
std::string expect_standing(Device& d) {
  if (!d.supports(9)) return "it stood before";
  const auto limit = d.speed() / 5;
  const bool stands = d.bus.until([&] { return std::abs(velocity(d)) <= limit; }, longest_stop_ns);
  const std::string seen = fmt::format("606Ch = {}", velocity(d));
  expect(stands, fmt::format("606Ch within {}", limit), seen);
  return seen;
}

void choose(Device& d, std::uint16_t index, int option) {
  d.needs(index);
  if (d.refusal(index, 0, option)) throw NotApplicable{fmt::format("{:04X}h refuses {}", index, option)};
}

/// The drive runs, gets `word`, and ends standing in `after`.
std::string stop(Device& d, std::uint16_t word, S after) {
  run(d);
  d.control(word);
  d.expect_state(after, longest_stop_ns);
  const auto seen = expect_standing(d);
  d.bus.listen(200 * ms_ns);
  d.expect_state(after);
  return fmt::format("{}, {}", name_of(after), seen);
}

template <int option, S after>
std::string quick_stop(Device& d) {
  choose(d, od::quick_stop_option_code, option);
  return stop(d, 0x02, after);
}

template <int option>
std::string shutdown(Device& d) {
  choose(d, od::shutdown_option_code, option);
  return stop(d, 0x06, S::ready_to_switch_on);
}

template <int option>
std::string disable_operation(Device& d) {
  choose(d, od::disable_operation_option_code, option);
  return stop(d, 0x07, S::switched_on);
}

template <int option>
std::string fault_reaction(Device& d) {
  choose(d, od::fault_reaction_option_code, option);
  run(d);
  provoke_fault(d);
  d.expect_state(S::fault, longest_stop_ns);
  return fmt::format("fault, {}", expect_standing(d));
}

std::string quick_stop_reserved(Device& d) {
  d.needs(od::quick_stop_option_code);
  return d.expect_refused(od::quick_stop_option_code, 0, 9, {0x06090030, 0x06090031});
}

/// Halt is optional in the cyclic modes; a drive with 605Dh has it.
template <int option>
std::string halts(Device& d) {
  choose(d, od::halt_option_code, option);
  if (!d.supports(9)) throw NotApplicable{"6502h does not name CSV"};
  run(d);
  const auto target = d.get_signed(od::target_velocity);
  d.control(enable | halt);
  const auto seen = expect_standing(d);
  d.expect_state(S::operation_enabled);
  const bool reached = d.bus.until([&] { return d.status() & target_reached; }, longest_stop_ns);
  const auto word = d.status();
  d.control(enable);
  const bool on = d.bus.until([&] { return runs_at(velocity(d), target); }, longest_stop_ns);
  expect(reached, "bit 10 of the statusword at standstill", fmt::format("{:04X}h", word));
  expect(on, "it runs again when bit 8 is 0", fmt::format("606Ch = {}", velocity(d)));
  return seen + ", operation enabled, bit 10; runs again";
}

// ---- Lost commands.

/// Power is off in the end, and the motor stands. Which state it is, 6007h and the drive decide.
std::string expect_off(Device& d) {
  const auto seen = expect_standing(d);
  const auto now = d.state();
  const bool off = now && *now != S::operation_enabled && *now != S::fault_reaction_active;
  const std::string text = fmt::format("statusword {:04X}h, {}", d.status(), seen);
  expect(off, "the drive is no more in operation enabled", text);
  return text;
}

template <int option>
std::string abort_by_stop(Device& d) {
  choose(d, od::abort_connection_option_code, option);
  run(d);
  d.command(NmtCommand::stop);
  d.bus.listen(500 * ms_ns);
  d.pre_operational();
  return expect_off(d);
}

template <int option>
std::string abort_by_heartbeat(Device& d) {
  choose(d, od::abort_connection_option_code, option);
  d.needs(od::consumer_heartbeat_time, 1);
  run(d);
  d.bus.forget();
  watch_heartbeat(d, 100);
  d.bus.listen(600 * ms_ns);
  const auto codes = emergencies(d);
  const bool said = std::ranges::find(codes, 0x8130) != codes.end();
  const auto seen = expect_off(d);
  expect(said, "EMCY 8130h", codes.empty() ? "none" : "others");
  return seen + ", EMCY 8130h";
}

/// A reset of the communication is a lost connection, too.
std::string abort_by_reset(Device& d) {
  run(d);
  d.reset(NmtCommand::reset_communication);
  return expect_off(d);
}

// ---- Following error.

std::string following_error(Device& d) {
  if (!d.supports(8)) throw NotApplicable{"6502h does not name CSP"};
  d.needs(od::following_error_window);
  d.needs(od::following_error_time_out);
  const auto amplitude = d.amplitude();
  d.enable_in(8);
  const auto start = d.get_signed(od::position_actual_value);
  if (d.refusal(od::following_error_time_out, 0, 0)) throw NotApplicable{"6066h refuses 0"};
  if (d.refusal(od::following_error_window, 0, std::max<std::int64_t>(1, amplitude / 100)))
    throw NotApplicable{"6065h refuses a hundredth of the amplitude"};
  d.bus.forget();
  bool seen = false;
  for (int i = 1; i <= 4 && !seen; ++i) {
    d.put(od::target_position, 0, start + (i % 2 ? amplitude : 0));
    seen = d.bus.until(
        [&] {
          const auto word = d.status();
          const auto codes = emergencies(d);
          return (word & 0x2008) == 0x2000 || std::ranges::find(codes, 0x8611) != codes.end();
        },
        100 * ms_ns);
  }
  const std::string text = fmt::format("statusword {:04X}h, {} EMCY", d.status(), emergencies(d).size());
  expect(seen, "bit 13 of the statusword, or a fault with EMCY 8611h", text);
  return text;
}

constexpr auto motion = Needs::motion, none = Needs::nothing;
constexpr char quick_stop_codes[] = "CiA 402-2, 605Ah", fault_codes[] = "CiA 402-2, 605Eh",
               abort_codes[] = "CiA 402-2, 6007h", halt_codes[] = "CiA 402-2, 605Dh";

constexpr Check checks[] = {
    {"quick_stop.reserved", quick_stop_codes, "605Ah = 9 is refused.", none, quick_stop_reserved},
    {"quick_stop.0", quick_stop_codes, "0: power off, switch on disabled.", motion,
     quick_stop<0, S::switch_on_disabled>},
    {"quick_stop.1", quick_stop_codes, "1: slow down ramp, then switch on disabled.", motion,
     quick_stop<1, S::switch_on_disabled>},
    {"quick_stop.2", quick_stop_codes, "2: quick stop ramp, then switch on disabled.", motion,
     quick_stop<2, S::switch_on_disabled>},
    {"quick_stop.3", quick_stop_codes, "3: current limit, then switch on disabled.", motion,
     quick_stop<3, S::switch_on_disabled>},
    {"quick_stop.4", quick_stop_codes, "4: voltage limit, then switch on disabled.", motion,
     quick_stop<4, S::switch_on_disabled>},
    {"quick_stop.5", quick_stop_codes, "5: slow down ramp, stays in quick stop active.", motion,
     quick_stop<5, S::quick_stop_active>},
    {"quick_stop.6", quick_stop_codes, "6: quick stop ramp, stays in quick stop active.", motion,
     quick_stop<6, S::quick_stop_active>},
    {"shutdown.0", "CiA 402-2, 605Bh", "0: power off at once.", motion, shutdown<0>},
    {"shutdown.1", "CiA 402-2, 605Bh", "1: slow down ramp, then power off.", motion, shutdown<1>},
    {"disable_operation.0", "CiA 402-2, 605Ch", "0: power off at once.", motion, disable_operation<0>},
    {"disable_operation.1", "CiA 402-2, 605Ch", "1: slow down ramp, then power off.", motion, disable_operation<1>},
    {"fault_reaction.0", fault_codes, "0: power off at once, then fault.", motion, fault_reaction<0>},
    {"fault_reaction.1", fault_codes, "1: slow down ramp, then fault.", motion, fault_reaction<1>},
    {"fault_reaction.2", fault_codes, "2: quick stop ramp, then fault.", motion, fault_reaction<2>},
    {"halt.1", halt_codes, "1: slow down ramp, stays enabled with bit 10.", motion, halts<1>},
    {"halt.2", halt_codes, "2: quick stop ramp, stays enabled with bit 10.", motion, halts<2>},
    {"abort_connection.stop_1", abort_codes, "1: NMT stop is a fault.", motion, abort_by_stop<1>},
    {"abort_connection.stop_2", abort_codes, "2: NMT stop disables the voltage.", motion, abort_by_stop<2>},
    {"abort_connection.stop_3", abort_codes, "3: NMT stop is a quick stop.", motion, abort_by_stop<3>},
    {"abort_connection.heartbeat_1", abort_codes, "1: a lost heartbeat is a fault, EMCY 8130h.", motion,
     abort_by_heartbeat<1>},
    {"abort_connection.heartbeat_2", abort_codes, "2: a lost heartbeat disables the voltage, EMCY 8130h.", motion,
     abort_by_heartbeat<2>},
    {"abort_connection.heartbeat_3", abort_codes, "3: a lost heartbeat is a quick stop, EMCY 8130h.", motion,
     abort_by_heartbeat<3>},
    {"abort_connection.reset", abort_codes, "NMT reset communication ends the operation.", motion, abort_by_reset},
    {"following_error", "CiA 402-2, 6065h, 6066h",
     "Beyond the window for the time: bit 13, or a fault with EMCY 8611h.", motion, following_error},
};

}  // namespace

Checks reaction_checks() { return checks; }

}  // namespace tribotwin::hil
