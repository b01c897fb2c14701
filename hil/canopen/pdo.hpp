#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include <tribotwin/hil/canopen/communication_objects.hpp>
#include <tribotwin/hil/canopen/emcy.hpp>
#include <tribotwin/hil/canopen/node_context.hpp>

/// Process data objects (CiA 301, 7.2.2): frames of up to 8 bytes with the values of the objects that the mapping
/// parameters name. Transmission types: 0 with SYNC on change, 1..240 every n-th SYNC, 254 and 255 event.
namespace tribotwin::hil {

/// How an RPDO brought an object.
struct PdoDelivery {
  bool exists = false;
  int every_syncs = 0;        ///< transmission type in SYNCs, at least 1; 0: event-driven
  bool own_deadline = false;  ///< the RPDO has one (140xh:05)
};

class PdoService {
 public:
  PdoService(NodeContext& node, Emcy& emcy);

  /// Whether an object is a parameter of a PDO.
  static bool owns(std::uint16_t index);
  /// Rules for writes to the parameters: mapping, identifier and inhibit time change while the PDO does not exist (bit
  /// 31).
  tl::expected<void, Abort> may_write(const Object& object, std::int64_t value) const;
  /// Reads the parameters again.
  void reload();
  /// Forgets all that was received and sent, and reads the parameters.
  void reset();
  /// NMT entered operational.
  void start();

  /// Whether this node sends PDOs with this identifier.
  bool sends(std::uint32_t cob_id) const;
  /// Whether it receives PDOs with this identifier.
  bool takes(std::uint32_t cob_id) const;
  /// A data frame in operational. Synchronous PDOs wait for the SYNC.
  void receive(const Frame& frame, std::int64_t now_ns);
  /// Sends what is due with the SYNC, then accepts the RPDOs that came before it.
  /// `counter`: of the SYNC, if it has one.
  void sync(std::int64_t now_ns, std::optional<std::uint8_t> counter);
  /// How many RPDOs passed their deadline since the last call. Each is watched again from its next arrival on.
  int late(std::int64_t now_ns);
  /// Event-driven TPDOs.
  void tick(std::int64_t now_ns);
  /// Next time at which `late` or `tick` has something to do.
  std::int64_t next_ns() const;
  bool any_synchronous_rpdo() const;
  /// Whether an RPDO brought this object since the last call, and how. Forgets all that came.
  PdoDelivery delivery(std::uint16_t index, std::uint16_t or_index = 0);

 private:
  struct Pdo {
    std::uint32_t cob = 0;
    bool exists = false, pending = false, sent_once = false, delivered = false;
    std::uint8_t type = 255, syncs = 0;
    std::uint8_t start = 0;  // counter of the SYNC with which it begins
    bool started = false;    // by that SYNC
    std::int64_t inhibit_ns = 0, timer_ns = 0, last_ns = 0;
    std::vector<Object*> map;                          // null: a gap
    std::vector<int> sizes;                            // bytes
    std::vector<std::optional<std::int64_t>> refused;  // the last value, where the object refused it
    int size = 0;
    std::array<std::uint8_t, pdo_bytes> data{};

    bool synchronous() const { return type <= last_synchronous; }
    bool event_driven() const { return type >= first_event; }
    /// Whether the inhibit time keeps it from being sent now.
    bool inhibited(std::int64_t now_ns) const {
      return exists && event_driven() && sent_once && now_ns - last_ns < inhibit_ns;
    }
  };
  static constexpr std::uint8_t last_synchronous = 240, first_event = 254;

  tl::expected<void, Abort> may_map(const Object& object, std::int64_t value) const;
  tl::expected<void, Abort> may_set_cob(const Object& object, std::int64_t value) const;
  tl::expected<int, Abort> mapped_bytes(MappingEntry entry, bool receive) const;
  void load(Pdo& pdo, bool transmit, int number);
  void accept(Pdo& pdo);
  void report_refused(const Object& object, std::int64_t value);
  std::array<std::uint8_t, pdo_bytes> gather(const Pdo& pdo) const;
  void send(Pdo& pdo, std::int64_t now_ns);
  /// Whether the PDO waits for the SYNC with its counter.
  bool waits(Pdo& pdo, std::optional<std::uint8_t> counter) const;

  NodeContext& node_;
  Emcy& emcy_;
  std::array<Pdo, pdo_count> receive_, transmit_;
  bool held_back_ = false;  // an inhibit time may keep a changed PDO from being sent
};

}  // namespace tribotwin::hil
