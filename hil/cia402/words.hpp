#pragma once

#include <cstdint>

/// Bits of the controlword 6040h and the statusword 6041h (CiA 402-2) beside those of the states.
namespace tribotwin::hil {

enum Control : std::uint16_t {
  enable_voltage = 0x0002,
  operation_specific = 0x0010,  ///< PP: new set point; HM: start; IP: enable
  change_immediately = 0x0020,  ///< PP
  relative = 0x0040,            ///< PP
  halt = 0x0100
};

enum Status : std::uint16_t {
  voltage_enabled = 0x0010,
  warning = 0x0080,
  remote = 0x0200,
  target_reached = 0x0400,  ///< also: halted, and at rest
  internal_limit_active = 0x0800,
  mode_bit_12 = 0x1000,  ///< follows; PP: set point acknowledged; PV: speed is 0; HM: attained; IP: active
  mode_bit_13 = 0x2000   ///< following error; HM: homing error
};

}  // namespace tribotwin::hil
