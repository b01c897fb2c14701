#pragma once

#include <array>
#include <cstdint>

#include <tribotwin/hil/canopen/node_context.hpp>

/// Error control: heartbeats (CiA 301, 7.2.8.3.2) and node guarding. A heartbeat is the frame 700h + node with one
/// byte, the NMT state; 0 is the boot-up message.
namespace tribotwin::hil {

/// Sends this node's heartbeat every 1017h.
class HeartbeatProducer {
 public:
  explicit HeartbeatProducer(NodeContext& node);
  void boot_up(std::int64_t now_ns);
  void tick(std::int64_t now_ns);
  /// Time of the next heartbeat; the largest time if there is none.
  std::int64_t next_ns() const;

 private:
  std::int64_t period_ns() const { return period_->value * ns_per_ms; }

  NodeContext& node_;
  const Object* period_;
  std::int64_t last_ns_ = 0;
};

/// Watches the heartbeats of other nodes (1016h), each from its first one on.
class HeartbeatConsumer {
 public:
  /// CiA 301: every node is watched by one entry at most.
  tl::expected<void, Abort> may_configure(const Object& entry, std::int64_t value) const;
  /// Entry 1016h:SUB was written.
  void configure(const Object& entry);
  void hear(std::uint32_t cob_id, std::int64_t now_ns);
  /// Whether frames with this identifier are heartbeats that it watches.
  bool watches(std::uint32_t cob_id) const;
  /// How many heartbeats were lost since the last call. A lost one is watched again from its next arrival on.
  int lost(std::int64_t now_ns);
  /// Next time at which a heartbeat is lost.
  std::int64_t next_ns() const;

 private:
  /// An entry; one without a node or a time watches nothing and has no period.
  struct Watched {
    std::uint8_t node = 0;
    std::int64_t period_ns = 0, last_ns = -1;

    static Watched of(std::int64_t value) {
      const auto node = static_cast<std::uint8_t>(value >> 16);
      return {node, node ? (value & 0xffff) * ns_per_ms : 0};
    }
  };
  std::array<Watched, 2> watched_;
};

/// Answers a master that guards this node (CiA 301, 7.2.8.3.2.1): a remote frame 700h + node is answered with the NMT
/// state and a toggle bit. From the first one on the node watches the master in turn (100Ch x 100Dh). A node with a
/// heartbeat (1017h) does neither.
class NodeGuard {
 public:
  explicit NodeGuard(NodeContext& node);
  void asked(std::int64_t now_ns);
  /// Whether the master was silent for too long; said once, then watched again from its next request on.
  bool lost(std::int64_t now_ns);
  /// Next time at which it was.
  std::int64_t next_ns() const;
  void reset() { toggle_ = false, last_ns_ = -1; }

 private:
  std::int64_t life_ns() const { return heartbeat_->value ? 0 : guard_time_->value * life_factor_->value * ns_per_ms; }

  NodeContext& node_;
  const Object *guard_time_, *life_factor_, *heartbeat_;
  bool toggle_ = false;
  std::int64_t last_ns_ = -1;
};

}  // namespace tribotwin::hil
