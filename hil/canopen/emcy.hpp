#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <limits>
#include <span>

#include <tribotwin/hil/canopen/node_context.hpp>

/// Emergency messages (CiA 301, 7.2.7): frame 080h + node with 8 bytes: error code (2), error register, 5 of our own.
namespace tribotwin::hil {

/// Error codes of this node (CiA 301, 7.2.7.1; CiA 402).
enum class ErrorCode : std::uint16_t {
  none = 0x0000,
  excess_temperature = 0x4310,  ///< of the drive
  left_operational = 0x8100,    ///< NMT took the node out of operational
  heartbeat_lost = 0x8130,      ///< life guard or heartbeat error
  bus_recovered = 0x8140,       ///< recovered from bus off
  sync_length = 0x8240,         ///< a SYNC with a counter where none is expected, or without
  pdo_too_short = 0x8210,       ///< PDO not processed because of a length error
  rpdo_timeout = 0x8250,        ///< RPDO deadline
  parameter_error = 0x6320,     ///< an RPDO with a value that an object refuses
  following_error = 0x8611,
  sync_lost = 0x8700,  ///< sync controller
  external = 0x9000,   ///< safe torque off
};

/// Bits of the error register 1001h (CiA 301, 7.5.2.2).
enum ErrorRegister : std::uint8_t {
  generic_error = 0x01,
  temperature_error = 0x08,
  communication_error = 0x10,
  profile_error = 0x20
};

class Emcy {
 public:
  explicit Emcy(NodeContext& node);

  /// An error that stays until `clear`: into the register and the history 1003h, and onto the bus unless NMT stopped.
  void raise(std::uint16_t code, std::uint8_t register_bits, std::span<const std::uint8_t> extra = {});
  /// An error of the moment: sent and kept in the history, then withdrawn from the register.
  void report(ErrorCode code, std::span<const std::uint8_t> extra = {},
              std::uint8_t register_bits = communication_error);
  /// All errors are gone: error reset (code 0).
  void clear();
  /// As after power-up, without a message.
  void reset();
  /// Sends what the inhibit time (1015h) held back.
  void tick(std::int64_t now_ns);
  /// Next time at which `tick` has something to send.
  std::int64_t next_ns() const;
  /// 0 was written to 1003h:00.
  void clear_history();

 private:
  void send(std::uint16_t code, std::span<const std::uint8_t> extra);
  void remember(std::uint16_t code);

  using Message = std::array<std::uint8_t, 8>;
  void put(const Message& message, std::int64_t now_ns);
  std::int64_t inhibit_ns() const { return inhibit_->value * 100'000; }

  NodeContext& node_;
  Object* register_object_;
  const Object* inhibit_;
  std::deque<Message> held_back_;
  std::int64_t last_ns_ = std::numeric_limits<std::int64_t>::min() / 2;
  std::uint8_t register_ = 0;
};

}  // namespace tribotwin::hil
