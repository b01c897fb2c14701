#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include <tribotwin/hil/can/frame.hpp>
#include <tribotwin/plugins/friction/error.hpp>

/// Transports of CAN frames, chosen by an address:
///   can0, vcan0, socketcan:NAME            SocketCAN, classic and FD
///   socketcand://127.0.0.1:29536/NAME      serves that bus over TCP; classic frames only
///   gateway://HOST:29536/NAME              a bus that a socketcand elsewhere serves; classic frames only
///   log:FILE                               a candump log: read by replay, written by --record
///   memory:NAME                            in this process
namespace tribotwin::hil {

/// What happened on a bus since it was opened.
struct BusCounters {
  std::uint64_t sent = 0, received = 0;
  std::uint64_t send_busy = 0;     ///< dropped because the queue was full (ENOBUFS)
  std::uint64_t send_down = 0;     ///< not sent because the link was down or the device gone
  std::uint64_t send_refused = 0;  ///< not a frame this bus can carry (FD on a classic bus, wrong length)
  std::uint64_t receive_lost = 0;  ///< lost in our own receive buffer (SO_RXQ_OVFL)
  std::uint64_t error_frames = 0;  ///< from the controller
  std::uint64_t bus_off = 0;
  std::uint64_t link_losses = 0;  ///< times that the link went down or the device vanished
  std::uint64_t malformed = 0;    ///< received, but not a frame

  /// Frames that a bus with room and a link would have carried.
  std::uint64_t lost() const { return receive_lost + send_busy + send_down; }
};

enum class Sent { done, busy, down, refused };

/// One end of a bus. No call but `wait` ever blocks. For one thread.
class Transport {
 public:
  virtual ~Transport() = default;

  /// Cyclic data that cannot be sent now is stale later: it is counted and dropped, the caller decides what to repeat.
  virtual Sent send(const Frame& frame) = 0;
  /// The next frame that others sent, in the order of the bus; false if there is none now.
  virtual bool receive(Frame& frame) = 0;
  /// Returns when a frame may have arrived, or at CLOCK_MONOTONIC `deadline_ns`, or when a signal arrives.
  virtual void wait(std::int64_t deadline_ns) = 0;
  /// Whether frames can be sent now. The transport follows a link that comes back and a device that is created again.
  virtual bool up() const = 0;
  /// "interface vcan0 is down", ...; for status lines.
  virtual std::string state() const = 0;

  const std::string& name() const { return name_; }
  /// Bit rate [bit/s] of a bus that has one; virtual ones and TCP have none.
  virtual std::optional<double> bit_rate() const { return std::nullopt; }
  virtual const BusCounters& counters() const { return counters_; }

 protected:
  explicit Transport(std::string name) : name_(std::move(name)) {}
  std::string name_;
  BusCounters counters_;
};

struct OpenOptions {
  bool fd = false;           ///< also send and receive FD frames
  bool listen_only = false;  ///< `send` refuses
  /// Only data frames with these 11-bit identifiers are received, plus error frames; all if empty.
  std::vector<std::uint32_t> identifiers;
  /// socketcand: a connection that says nothing for so long before it joined the bus is dropped.
  std::int64_t handshake_ns = 5'000'000'000;
};

/// Fails with what is wrong and what would help, in one line.
Result<std::unique_ptr<Transport>> open_bus(const std::string& address, const OpenOptions& options = {});

/// The transports behind open_bus.
Result<std::unique_ptr<Transport>> open_socketcan(const std::string& interface, const OpenOptions& options);
Result<std::unique_ptr<Transport>> open_socketcand(const std::string& host, int port, const std::string& bus,
                                                   const OpenOptions& options);
/// Waits up to 3 s for the gateway. A connection that is lost later is tried again every second.
Result<std::unique_ptr<Transport>> open_gateway(const std::string& host, int port, const std::string& bus,
                                                const OpenOptions& options);
/// Ends of one bus in this process: what one sends, all others receive. Ends may live in different threads.
std::unique_ptr<Transport> open_memory(const std::string& bus, const OpenOptions& options);

}  // namespace tribotwin::hil
