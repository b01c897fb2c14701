#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/hil/canopen/dictionary.hpp>
#include <tribotwin/hil/cia402/state_machine.hpp>
#include <tribotwin/hil/conform/client.hpp>
#include <tribotwin/hil/conform/eds_file.hpp>

namespace tribotwin::hil {

/// Thrown by a check: the device behaves otherwise.
struct Mismatch {
  std::string expected, seen;
};
/// Thrown by a check: it cannot be made on this device.
struct NotApplicable {
  std::string reason;
};

/// Throws Mismatch unless `holds`.
void expect(bool holds, std::string expected, std::string seen);

struct ConformOptions {
  const Eds* eds = nullptr;
  bool motion = false;                                   ///< also checks that enable the drive and move it
  bool homing = false;                                   ///< and those that give it a new reference position
  std::int64_t boot_ns = 5'000'000'000;                  ///< time that the device has for a reset
  std::vector<std::string> only;                         ///< of the checks, see checks_named; empty: all
  std::optional<std::int64_t> amplitude, speed, torque;  ///< of motion checks, in counts of 6064h, 606Ch, 6077h
};

constexpr double default_turns = 1.0 / 12;     ///< amplitude, of the motor, where 608Fh tells its counts
constexpr double default_speed_rpm = 30;       ///< of the motor, where 60A9h tells its unit
constexpr std::int64_t default_torque = 20;    ///< per mille of the rated torque 6076h
constexpr std::int64_t cycle_ns = 10'000'000;  ///< SYNC period of motion checks

/// The device as the checks see it. What a check changes by `set` is taken back by `restore`. Reads and writes throw
/// Mismatch where the device refuses them.
class Device {
 public:
  Device(Client& client, const ConformOptions& chosen) : bus(client), options(chosen) {}

  Client& bus;
  const ConformOptions& options;
  std::uint8_t node() const { return bus.node(); }

  // ---- Objects.
  bool has(std::uint16_t index, std::uint8_t sub = 0);
  Bytes bytes(std::uint16_t index, std::uint8_t sub = 0);
  std::int64_t get(std::uint16_t index, std::uint8_t sub = 0);
  std::int64_t get_signed(std::uint16_t index, std::uint8_t sub = 0);
  /// With the length that the object has.
  void put(std::uint16_t index, std::uint8_t sub, std::int64_t value);
  /// As `put`; `restore` writes the old value.
  void set(std::uint16_t index, std::uint8_t sub, std::int64_t value);
  /// `restore` writes the value that the object has now.
  void keep(std::uint16_t index, std::uint8_t sub);
  /// Abort code of a write of `size` bytes (0: the object's own); nothing if the device accepts it. What was accepted
  /// is taken back by `restore`.
  std::optional<std::uint32_t> refusal(std::uint16_t index, std::uint8_t sub, std::int64_t value, std::size_t size = 0);
  /// Throws Mismatch unless a write ends with one of these aborts. Returns which, as text.
  std::string expect_refused(std::uint16_t index, std::uint8_t sub, std::int64_t value,
                             std::vector<std::uint32_t> codes, std::size_t size = 0);
  /// Takes back what `set` and `refusal` changed, the last first. Returns what could not be written.
  std::vector<std::string> restore();
  /// NotApplicable where the object is missing.
  void needs(std::uint16_t index, std::uint8_t sub = 0);

  // ---- NMT.
  void pre_operational() { command(NmtCommand::enter_pre_operational); }
  void operational() { command(NmtCommand::start); }
  void command(NmtCommand command);
  /// Waits for the boot-up message and for the SDO server.
  void reset(NmtCommand command);
  /// From the next heartbeat; it has to be on (`hear_heartbeat`).
  std::uint8_t nmt_state();
  /// Heartbeat every 50 ms. NotApplicable where the device has none.
  void hear_heartbeat();

  // ---- Drive.
  std::uint16_t status() { return static_cast<std::uint16_t>(get(0x6041)); }
  std::optional<DriveState> state();
  void control(std::uint16_t word) { put(0x6040, 0, word); }
  /// Throws Mismatch unless the drive is in `state` within the time.
  void expect_state(DriveState state, std::int64_t within_ns = 1'000'000'000);
  /// By the ordinary way from whatever state; fault reset included.
  void bring_to(DriveState state);
  /// Without power, and out of fault; how, does not matter. False if the drive stays in a fault or enabled.
  bool make_safe();
  bool supports(int mode) { return has(0x6502) && (get(0x6502) >> (mode - 1) & 1); }
  void set_mode(int mode);

  // ---- Motion: SYNCs go on, and 1006h and 60C2h know their period.
  void start_cycle();
  /// Mode, operational, enabled, and the target where the motor stands.
  void enable_in(int mode);
  std::int64_t amplitude();
  std::int64_t speed();
  std::int64_t torque() { return options.torque.value_or(default_torque); }
  /// 1 and -1 in turns, so that the checks together do not lead away.
  int next_direction() { return direction_ = -direction_; }
  /// The first supported one of CSP, CSV, CST, PP, PV. NotApplicable without.
  int any_mode();

 private:
  std::size_t size_of(std::uint16_t index, std::uint8_t sub);

  std::map<std::uint32_t, bool> known_;
  std::map<std::uint32_t, std::size_t> sizes_;  // bytes
  int direction_ = -1;
  struct Change {
    std::uint16_t index;
    std::uint8_t sub;
    Bytes before;
  };
  std::vector<Change> changes_;
};

std::string hex(std::uint64_t value, int digits);
std::optional<DriveState> state_of(std::uint16_t statusword);

constexpr std::int64_t ms_ns = 1'000'000;

}  // namespace tribotwin::hil
