#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include <tribotwin/hil/can/clock.hpp>
#include <tribotwin/hil/can/transport.hpp>
#include <tribotwin/hil/canopen/nmt.hpp>

namespace tribotwin::hil {

/// Why an SDO transfer has no result.
struct SdoFailure {
  enum class Kind { aborted, no_answer, wrong_answer } kind;
  std::uint32_t code = 0;  ///< of the abort
  std::string what{};      ///< of a wrong answer

  /// "abort 06020000h", "no answer within 500 ms", "wrong answer: ...".
  std::string text() const;
};

using Bytes = std::vector<std::uint8_t>;
using SdoFrame = std::array<std::uint8_t, 8>;

/// Thrown by every wait of a client when `stop` of the options says so.
struct Interrupted {};

struct ClientOptions {
  std::function<std::int64_t()> now_ns = [] { return clock_ns(); };  ///< the clock of Transport::wait
  std::function<bool()> stop = [] { return false; };
  std::int64_t sdo_timeout_ns = 500'000'000;
};

/// A frame and the time, by the clock of the options, at which the client read it.
struct HeardFrame {
  Frame frame;
  std::int64_t time_ns;
};

/// A small CANopen master for one node: SDO client (expedited and segmented), NMT, SYNC producer, and a record of all
/// data frames on the bus. Everything happens inside its waits; it has no thread.
class Client {
 public:
  Client(Transport& bus, std::uint8_t node, ClientOptions options = {});

  std::uint8_t node() const { return node_; }
  std::int64_t now_ns() const { return options_.now_ns(); }
  /// From now on `stop` interrupts no wait: for leaving the node as it was.
  void finish_undisturbed() {
    options_.stop = [] { return false; };
  }

  // ---- Time. The waits keep the cycle going.
  void listen(std::int64_t duration_ns);
  /// Whether `condition` held within the time.
  bool until(const std::function<bool()>& condition, std::int64_t duration_ns);

  // ---- Frames.
  void send(std::uint32_t id, std::span<const std::uint8_t> bytes);
  void nmt(NmtCommand command) { nmt(command, node_); }
  void nmt(NmtCommand command, std::uint8_t node);
  void sync(std::uint32_t id = 0x080);
  /// Sends a SYNC every period, and `before` each if it is set. 0 ends it.
  void cycle(std::int64_t period_ns, std::function<void()> before = {});
  std::int64_t cycle_ns() const { return cycle_ns_; }
  /// What was heard since the last `forget`, at most the last 100,000 frames.
  const std::deque<HeardFrame>& heard() const { return heard_; }
  std::vector<HeardFrame> heard(std::uint32_t id) const;
  void forget() { heard_.clear(); }

  // ---- SDO.
  tl::expected<Bytes, SdoFailure> upload(std::uint16_t index, std::uint8_t sub);
  /// Expedited for 1 to 4 bytes, else segmented.
  tl::expected<void, SdoFailure> download(std::uint16_t index, std::uint8_t sub, std::span<const std::uint8_t> bytes);
  tl::expected<void, SdoFailure> download_segmented(std::uint16_t index, std::uint8_t sub,
                                                    std::span<const std::uint8_t> bytes);
  /// Sends these 8 bytes and waits for the server's next frame.
  tl::expected<SdoFrame, SdoFailure> request(const SdoFrame& bytes);
  /// As `request`; an abort is a failure.
  tl::expected<SdoFrame, SdoFailure> transfer(const SdoFrame& bytes);
  void abort(std::uint16_t index, std::uint8_t sub, std::uint32_t code);

 private:
  void turn(std::int64_t deadline_ns);
  void serve_cycle();
  tl::expected<Bytes, SdoFailure> upload_segments(std::size_t announced);

  Transport& bus_;
  std::uint8_t node_;
  ClientOptions options_;
  std::deque<HeardFrame> heard_;
  std::optional<SdoFrame> answer_;
  std::int64_t cycle_ns_ = 0, next_cycle_ns_ = 0;
  std::function<void()> before_sync_;
};

/// A request or answer that names an object: command byte, index, sub-index, and a value of 4 bytes.
SdoFrame sdo_frame(std::uint8_t command, std::uint16_t index, std::uint8_t sub, std::uint32_t value = 0);
/// The 4 bytes of data, or the abort code.
std::uint32_t sdo_value(const SdoFrame& frame);

}  // namespace tribotwin::hil
