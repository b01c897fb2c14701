#pragma once

#include <cstdint>
#include <optional>

#include <tribotwin/hil/can/frame.hpp>
#include <tribotwin/hil/canopen/cob_id.hpp>

/// Network management (CiA 301, 7.2.8): the frame 000h with two bytes, command and node number (0: all nodes).
namespace tribotwin::hil {

/// NMT state, with the number that the heartbeat sends.
enum class Nmt : std::uint8_t { initialising = 0x00, stopped = 0x04, operational = 0x05, pre_operational = 0x7F };

enum class NmtCommand : std::uint8_t {
  start = 0x01,
  stop = 0x02,
  enter_pre_operational = 0x80,
  reset_node = 0x81,
  reset_communication = 0x82
};

/// The command to `node`; none if it is for another one or unknown. `frame`: a data frame with identifier cob::nmt.
inline std::optional<NmtCommand> nmt_command(const Frame& frame, std::uint8_t node) {
  if (frame.size != 2 || (frame.data[1] != 0 && frame.data[1] != node)) return std::nullopt;
  switch (const NmtCommand command{frame.data[0]}) {
    case NmtCommand::start:
    case NmtCommand::stop:
    case NmtCommand::enter_pre_operational:
    case NmtCommand::reset_node:
    case NmtCommand::reset_communication:
      return command;
  }
  return std::nullopt;
}

}  // namespace tribotwin::hil
