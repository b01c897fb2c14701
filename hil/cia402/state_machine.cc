#include <tribotwin/hil/cia402/state_machine.hpp>

namespace tribotwin::hil {

using S = DriveState;

const char* name_of(DriveState state) {
  constexpr const char* names[] = {"switch on disabled", "ready to switch on",    "switched on", "operation enabled",
                                   "quick stop active",  "fault reaction active", "fault"};
  return names[static_cast<int>(state)];
}

std::uint16_t StateMachine::status_bits() const {
  constexpr std::uint16_t bits[] = {0x40, 0x21, 0x23, 0x27, 0x07, 0x0F, 0x08};
  return bits[static_cast<int>(state_)];
}

void StateMachine::leave(DriveState next, bool ramp) {
  next_ = next;
  ramping_ = ramp;
  if (!ramp) state_ = next;
}

void StateMachine::controlword(std::uint16_t word, const StopOptions& o) {
  const bool reset = (word & 0x80) && !(last_ & 0x80);
  last_ = word;
  if (state_ == S::fault && reset) return leave(S::switch_on_disabled, false);
  if (state_ == S::fault || state_ == S::fault_reaction_active) return;
  enum class Command { disable_voltage, quick_stop, shutdown, switch_on, enable } command = Command::enable;
  if (!(word & 0x02))
    command = Command::disable_voltage;
  else if (!(word & 0x04))
    command = Command::quick_stop;
  else if (!(word & 0x01))
    command = Command::shutdown;
  else if (!(word & 0x08))
    command = Command::switch_on;

  switch (state_) {
    case S::switch_on_disabled:
      if (command == Command::shutdown) state_ = S::ready_to_switch_on;
      return;
    case S::ready_to_switch_on:
    case S::switched_on:
      if (command == Command::disable_voltage || command == Command::quick_stop) state_ = S::switch_on_disabled;
      if (command == Command::shutdown) state_ = S::ready_to_switch_on;
      if (command == Command::switch_on) state_ = S::switched_on;
      if (command == Command::enable) leave(S::operation_enabled, false);
      return;
    case S::operation_enabled:
      if (command == Command::disable_voltage) return leave(S::switch_on_disabled, false);
      if (command == Command::quick_stop) {
        if (o.quick_stop == 0) return leave(S::switch_on_disabled, false);
        state_ = S::quick_stop_active;
        hold_ = o.quick_stop >= 5;
        ramping_ = true;
        next_ = S::switch_on_disabled;
        return;
      }
      if (ramping_) return;  // a ramp leads out of the state: only quick stop and disable voltage count
      if (command == Command::shutdown) leave(S::ready_to_switch_on, o.shutdown == 1);
      if (command == Command::switch_on) leave(S::switched_on, o.disable_operation == 1);
      return;
    case S::quick_stop_active:
      if (command == Command::disable_voltage) leave(S::switch_on_disabled, false);
      if (command == Command::enable && hold_) leave(S::operation_enabled, false);
      return;
    default:
      return;
  }
}

void StateMachine::fail(bool ramp) {
  if (state_ == S::fault || state_ == S::fault_reaction_active) return;
  const bool brakes = ramp && powered();
  state_ = brakes ? S::fault_reaction_active : S::fault;
  next_ = S::fault;
  ramping_ = brakes;
}

void StateMachine::stopped() {
  if (!ramping_) return;
  ramping_ = false;
  if (state_ == S::quick_stop_active && hold_) return;
  state_ = next_;
}

}  // namespace tribotwin::hil
