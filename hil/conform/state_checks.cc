#include <algorithm>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/conform/checks.hpp>

namespace tribotwin::hil {
namespace {

using S = DriveState;

constexpr std::uint16_t shutdown = 0x06, switch_on = 0x07, enable = 0x0F, quick_stop = 0x02, disable_voltage = 0x00,
                        fault_reset = 0x80;

constexpr bool powered(S state) { return state == S::operation_enabled || state == S::quick_stop_active; }

/// 605Ah such that the drive stays in quick stop active.
void hold_quick_stop(Device& d) {
  if (!d.has(od::quick_stop_option_code)) throw NotApplicable{"there is no 605Ah"};
  if (d.refusal(od::quick_stop_option_code, 0, 6) && d.refusal(od::quick_stop_option_code, 0, 5))
    throw NotApplicable{"605Ah has neither 5 nor 6, so no quick stop stays active"};
}

/// Into the state from which a check begins.
void begin_in(Device& d, S state) {
  if (state == S::quick_stop_active) hold_quick_stop(d);
  if (powered(state)) {
    d.enable_in(d.any_mode());
  } else {
    d.operational();
  }
  d.bring_to(state);
}

std::string state_text(Device& d) { return fmt::format("statusword {:04X}h", d.status()); }

template <S from, std::uint16_t word, S to>
std::string transition(Device& d) {
  if (powered(to) && !powered(from)) {  // with a mode and a target
    d.enable_in(d.any_mode());
    d.bring_to(S::switch_on_disabled);
  }
  begin_in(d, from);
  d.control(word);
  d.expect_state(to, 3000 * ms_ns);
  return fmt::format("{}, {}", state_text(d), name_of(to));
}

/// Commands that have no meaning in a state keep it.
template <S state, std::uint16_t... words>
std::string keeps(Device& d) {
  begin_in(d, state);
  for (const std::uint16_t word : {words...}) {
    d.control(word);
    d.bus.listen(60 * ms_ns);
    const auto now = d.state();
    expect(now == state, fmt::format("{} after controlword {:04X}h", name_of(state), word),
           now ? name_of(*now) : state_text(d));
  }
  return name_of(state);
}

std::string after_reset(Device& d) {
  d.reset(NmtCommand::reset_node);
  d.expect_state(S::switch_on_disabled, 3000 * ms_ns);
  return state_text(d);
}

/// CiA 402-2, statusword: bit 5 is 0 in quick stop only, so 1 in these states.
std::string quick_stop_bit(Device& d) {
  d.operational();
  for (const S state : {S::ready_to_switch_on, S::switched_on}) {
    d.bring_to(state);
    expect(d.status() & 0x20, fmt::format("bit 5 in {}", name_of(state)), state_text(d));
  }
  return "set in ready to switch on and switched on";
}

std::string remote(Device& d) {
  d.operational();
  d.bus.listen(20 * ms_ns);
  expect(d.status() & 0x200, "bit 9 while the drive obeys its controlword in operational", state_text(d));
  d.control(shutdown);
  d.expect_state(S::ready_to_switch_on);
  return state_text(d);
}

std::string voltage_enabled(Device& d) {
  d.enable_in(d.any_mode());
  expect(d.status() & 0x10, "bit 4 in operation enabled", state_text(d));
  return state_text(d);
}

std::string same_by_pdo(Device& d) {
  const auto id = use_pdo(d, true, {map_statusword}, 1);
  d.operational();
  for (const S state : {S::ready_to_switch_on, S::switched_on, S::switch_on_disabled}) {
    d.bring_to(state);
    d.bus.forget();
    d.bus.sync();
    d.bus.listen(30 * ms_ns);
    const auto all = d.bus.heard(id);
    expect(!all.empty() && all.back().frame.size == 2, "a TPDO with the statusword", "none");
    const auto word = static_cast<std::uint16_t>(decode(Type::u16, all.back().frame.bytes()));
    expect(state_of(word) == state, name_of(state), fmt::format("{:04X}h by PDO", word));
  }
  return "three states";
}

// ---- Faults.

std::string fault(Device& d) {
  provoke_fault(d);
  d.expect_state(S::fault, 3000 * ms_ns);
  return state_text(d);
}

/// The state fault. A device that does not come there fails the check of `fault` alone.
void in_fault(Device& d) {
  try {
    fault(d);
  } catch (const Mismatch& m) {
    throw NotApplicable{fmt::format("no fault could be provoked: {} is not so", m.expected)};
  }
}

std::string fault_code(Device& d) {
  in_fault(d);
  d.needs(od::error_code);
  const auto code = d.get(od::error_code);
  const auto sent = emergencies(d);
  const auto reg = d.get(od::error_register);
  const std::string seen = fmt::format("603Fh = {:04X}h, 1001h = {:02X}h, {} EMCY", code, reg, sent.size());
  expect(code != 0 && std::ranges::find(sent, code) != sent.end() && (reg & 1),
         "603Fh as in the EMCY, 1001h with bit 0", seen);
  return seen;
}

std::string fault_keeps(Device& d) {
  in_fault(d);
  for (const std::uint16_t word : {shutdown, switch_on, enable, quick_stop, disable_voltage}) {
    d.control(word);
    d.bus.listen(40 * ms_ns);
    const auto now = d.state();
    expect(now == S::fault, fmt::format("fault after controlword {:04X}h", word), state_text(d));
  }
  return "fault";
}

std::string fault_resets(Device& d) {
  in_fault(d);
  d.control(disable_voltage);
  d.bus.forget();
  d.control(fault_reset);
  d.expect_state(S::switch_on_disabled);
  const auto reg = d.get(od::error_register);
  const auto codes = emergencies(d);
  expect(reg == 0 && std::ranges::find(codes, 0) != codes.end(), "1001h = 00h and EMCY 0000h after the reset",
         fmt::format("1001h = {:02X}h, {} EMCY", reg, codes.size()));
  return state_text(d) + ", EMCY 0000h";
}

/// A fault reset is a rising edge of bit 7.
std::string reset_edge(Device& d) {
  d.enable_in(d.any_mode());
  d.control(enable | fault_reset);
  d.expect_state(S::operation_enabled);
  in_fault(d);
  d.control(fault_reset);
  d.bus.listen(60 * ms_ns);
  const auto held = d.state();
  expect(held == S::fault, "fault while bit 7 stays 1", state_text(d));
  d.control(disable_voltage);
  d.control(fault_reset);
  d.expect_state(S::switch_on_disabled);
  return "bit 7 held: fault; 0 to 1: switch on disabled";
}

constexpr auto none = Needs::nothing, motion = Needs::motion;

constexpr char fsa[] = "CiA 402-2, PDS FSA";

// The transitions by their number. 0, 1 are after_reset; 13, 14 are fault.
constexpr Check checks[] = {
    {"state.00_01", "CiA 402-2, PDS FSA, transitions 0, 1", "After a reset the drive is in switch on disabled.", none,
     after_reset},
    {"state.02", "CiA 402-2, PDS FSA, transition 2", "Shutdown: ready to switch on.", none,
     transition<S::switch_on_disabled, shutdown, S::ready_to_switch_on>},
    {"state.03", "CiA 402-2, PDS FSA, transition 3", "Switch on: switched on.", none,
     transition<S::ready_to_switch_on, switch_on, S::switched_on>},
    {"state.06", "CiA 402-2, PDS FSA, transition 6", "Switched on, shutdown: ready to switch on.", none,
     transition<S::switched_on, shutdown, S::ready_to_switch_on>},
    {"state.07_quick_stop", "CiA 402-2, PDS FSA, transition 7", "Ready to switch on, quick stop: switch on disabled.",
     none, transition<S::ready_to_switch_on, quick_stop, S::switch_on_disabled>},
    {"state.07_disable_voltage", "CiA 402-2, PDS FSA, transition 7",
     "Ready to switch on, disable voltage: switch on disabled.", none,
     transition<S::ready_to_switch_on, disable_voltage, S::switch_on_disabled>},
    {"state.10_quick_stop", "CiA 402-2, PDS FSA, transition 10", "Switched on, quick stop: switch on disabled.", none,
     transition<S::switched_on, quick_stop, S::switch_on_disabled>},
    {"state.10_disable_voltage", "CiA 402-2, PDS FSA, transition 10",
     "Switched on, disable voltage: switch on disabled.", none,
     transition<S::switched_on, disable_voltage, S::switch_on_disabled>},
    {"state.keeps_switch_on_disabled", fsa, "In switch on disabled only shutdown has an effect.", none,
     keeps<S::switch_on_disabled, switch_on, enable, quick_stop, disable_voltage>},
    {"state.keeps_ready", fsa, "In ready to switch on another shutdown has no effect.", none,
     keeps<S::ready_to_switch_on, shutdown>},
    {"state.keeps_switched_on", fsa, "In switched on another switch on has no effect.", none,
     keeps<S::switched_on, switch_on>},
    {"status.quick_stop", "CiA 402-2, 6041h, bit 5", "Bit 5 is set while there is no quick stop.", none,
     quick_stop_bit},
    {"status.remote", "CiA 402-2, 6041h, bit 9", "Bit 9 is set while the controlword is obeyed.", none, remote},
    {"status.pdo", "CiA 402-2, 6041h", "The statusword by PDO shows the state.", none, same_by_pdo},
    {"state.04", "CiA 402-2, PDS FSA, transition 4", "Enable operation: operation enabled.", motion,
     transition<S::switched_on, enable, S::operation_enabled>},
    {"state.03_04", "CiA 402-2, PDS FSA, transitions 3, 4", "Ready to switch on, enable operation: operation enabled.",
     motion, transition<S::ready_to_switch_on, enable, S::operation_enabled>},
    {"state.05", "CiA 402-2, PDS FSA, transition 5", "Disable operation: switched on.", motion,
     transition<S::operation_enabled, switch_on, S::switched_on>},
    {"state.08", "CiA 402-2, PDS FSA, transition 8", "Operation enabled, shutdown: ready to switch on.", motion,
     transition<S::operation_enabled, shutdown, S::ready_to_switch_on>},
    {"state.09", "CiA 402-2, PDS FSA, transition 9", "Operation enabled, disable voltage: switch on disabled.", motion,
     transition<S::operation_enabled, disable_voltage, S::switch_on_disabled>},
    {"state.11", "CiA 402-2, PDS FSA, transition 11", "Quick stop: quick stop active.", motion,
     [](Device& d) {
       hold_quick_stop(d);
       return transition<S::operation_enabled, quick_stop, S::quick_stop_active>(d);
     }},
    {"state.12", "CiA 402-2, PDS FSA, transition 12", "Quick stop active, disable voltage: switch on disabled.", motion,
     transition<S::quick_stop_active, disable_voltage, S::switch_on_disabled>},
    {"state.16", "CiA 402-2, PDS FSA, transition 16", "Quick stop active, enable operation: operation enabled.", motion,
     transition<S::quick_stop_active, enable, S::operation_enabled>},
    {"state.keeps_enabled", fsa, "In operation enabled another enable operation has no effect.", motion,
     keeps<S::operation_enabled, enable>},
    {"state.keeps_quick_stop", fsa, "In quick stop active shutdown and switch on have no effect.", motion,
     keeps<S::quick_stop_active, shutdown, switch_on, quick_stop>},
    {"state.13_14", "CiA 402-2, PDS FSA, transitions 13, 14", "A fault ends in the state fault.", motion, fault},
    {"state.keeps_fault", fsa, "In fault only a fault reset has an effect.", motion, fault_keeps},
    {"state.15", "CiA 402-2, PDS FSA, transition 15", "Fault reset: switch on disabled, EMCY 0000h, 1001h = 0.", motion,
     fault_resets},
    {"state.15_edge", "CiA 402-2, 6040h, bit 7", "Only the rising edge of bit 7 resets a fault.", motion, reset_edge},
    {"status.fault_code", "CiA 402-2, 603Fh", "603Fh is the code of the EMCY; 1001h has bit 0.", motion, fault_code},
    {"status.voltage_enabled", "CiA 402-2, 6041h, bit 4", "Bit 4 is set in operation enabled.", motion,
     voltage_enabled},
};

}  // namespace

Checks state_checks() { return checks; }

void provoke_fault(Device& d) {
  if (!d.has(od::consumer_heartbeat_time, 1) || !d.has(od::abort_connection_option_code))
    throw NotApplicable{"a fault cannot be provoked without 1016h and 6007h"};
  if (d.refusal(od::abort_connection_option_code, 0, 1)) throw NotApplicable{"6007h has no fault signal (1)"};
  if (d.state() != S::operation_enabled) d.enable_in(d.any_mode());
  d.bus.forget();
  watch_heartbeat(d, 100);
  const auto failed = [&] {
    const auto now = d.state();
    return now == S::fault || now == S::fault_reaction_active;
  };
  expect(d.bus.until(failed, 1500 * ms_ns), "a lost heartbeat (1016h) with 6007h = 1 leads to fault", state_text(d));
}

}  // namespace tribotwin::hil
