#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <tribotwin/hil/can/frame.hpp>

/// Frames as socketcand writes them in raw mode: https://github.com/linux-can/socketcand/blob/master/doc/protocol.md.
/// Identifiers of 29 bits have eight digits. `parts`: the words between < and >, as words() has them.
namespace tribotwin::hil::socketcand {

/// "< send ID length byte byte ... >", of a client.
std::string send_command(const Frame& frame);
/// None where it is no frame. A client (python-can) may send 29-bit identifiers without leading zeros.
std::optional<Frame> parse_send(std::span<const std::string_view> parts);

/// " < frame ID sec.usec HEX >", of the server.
std::string frame_command(const Frame& frame);
/// With the bytes in one word or several. None where it is no frame; without a time its time is 0.
std::optional<Frame> parse_frame(std::span<const std::string_view> parts);

}  // namespace tribotwin::hil::socketcand
