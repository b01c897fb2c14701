#pragma once

#include <span>
#include <string>
#include <vector>

#include <tribotwin/hil/conform/device.hpp>
#include <tribotwin/plugins/friction/error.hpp>

/// The checks as one table. Program, report, README.md and tests follow from its rows.
///
/// To add a check: one row in the table of its file, with a function that throws Mismatch or NotApplicable and returns
/// what it saw. Clauses are those of CiA 301 version 4.2.0; CiA 402-2 numbers its sections differently in each edition,
/// so a clause names the section or object.
namespace tribotwin::hil {

enum class Needs {
  nothing,
  motion,  ///< enables the drive or moves it: only with ConformOptions::motion
  homing   ///< changes its reference position: only with ConformOptions::homing, too
};

struct Check {
  const char* id;        ///< "sdo.toggle"
  const char* clause;    ///< "CiA 301, 7.2.4.3.6"
  const char* expected;  ///< of the device, one sentence
  Needs needs;
  /// Returns what was seen. The node is pre-operational, with its SDO server ready and the drive without power.
  std::string (*run)(Device&);
};

using Checks = std::span<const Check>;
Checks network_checks(), object_checks(), eds_checks(), sdo_checks(), service_checks(), pdo_parameter_checks(),
    pdo_checks(), emergency_checks(), state_checks(), reaction_checks(), mode_checks(), motion_checks();

/// All of them, in the order in which they run.
std::vector<Check> all_checks();
/// Those with one of these ids ("sdo.toggle") or of one of these groups ("sdo"), in the same order; without names all.
/// Fails for a name that no check has (ErrorKind::input).
Result<std::vector<Check>> checks_named(std::span<const std::string> names);
/// The table of README.md.
std::string checks_markdown();

/// A node number that nobody on the bus uses, as far as was heard.
std::uint8_t unused_node(const Device& device);
/// The drive is enabled and in a fault, provoked by a lost heartbeat (1016h, 6007h = 1). NotApplicable where the device
/// cannot be brought there.
void provoke_fault(Device& device);
/// The node watches the heartbeat of an unused node, and hears it once. NotApplicable without 1016h. Returns that node.
std::uint8_t watch_heartbeat(Device& device, int period_ms);
/// EMCY frames that came from the device since the last `forget`, by error code.
std::vector<std::uint16_t> emergencies(const Device& device);

/// A PDO of the device with this mapping, switched on at its pre-defined identifier. Returns the identifier.
/// NotApplicable where the PDO or its mapping cannot be changed.
std::uint32_t use_pdo(Device& device, bool transmit, std::vector<std::uint32_t> mapping, int type);

constexpr std::uint32_t map_controlword = 0x60400010, map_statusword = 0x60410010;

}  // namespace tribotwin::hil
