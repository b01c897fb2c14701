#pragma once

#include <cstdint>

/// The state machine of a drive (CiA 402, IEC 61800-7-201), free of time and bus.
namespace tribotwin::hil {

enum class DriveState : std::uint8_t {
  switch_on_disabled,
  ready_to_switch_on,
  switched_on,
  operation_enabled,
  quick_stop_active,
  fault_reaction_active,
  fault
};
const char* name_of(DriveState state);

/// Option codes 605Ah, 605Bh, 605Ch and 605Eh; their values are in the reference of hil/README.md.
struct StopOptions {
  int quick_stop = 2, shutdown = 0, disable_operation = 1, fault_reaction = 2;
};

class StateMachine {
 public:
  DriveState state() const { return state_; }
  /// The state's bits of the statusword: 0, 1, 2, 3, 5, 6.
  std::uint16_t status_bits() const;
  /// Power is on and the brake off.
  bool powered() const {
    return state_ == DriveState::operation_enabled || state_ == DriveState::quick_stop_active ||
           state_ == DriveState::fault_reaction_active;
  }
  /// The drive decelerates along a ramp; `stopped` ends it.
  bool ramping() const { return ramping_; }
  /// The drive follows set points: enabled, and no ramp leads out of the state.
  bool follows() const { return state_ == DriveState::operation_enabled && !ramping_; }

  void controlword(std::uint16_t word, const StopOptions& options);
  /// A fault: after a ramp if `ramp` and the drive is powered, else at once.
  void fail(bool ramp);
  /// Call when the motor stands: ends a ramp.
  void stopped();
  /// As after power-up.
  void reset() { *this = {}; }

 private:
  void leave(DriveState next, bool ramp);
  DriveState state_ = DriveState::switch_on_disabled, next_ = DriveState::switch_on_disabled;
  bool ramping_ = false, hold_ = false;  // hold: stays in quick stop active after its ramp
  std::uint16_t last_ = 0;
};

}  // namespace tribotwin::hil
