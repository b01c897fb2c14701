#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/node_context.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>

/// SYNC (CiA 301, 7.2.5): frame 080h without data or with a counter of one byte.
namespace tribotwin::hil {

inline bool is_sync(const Frame& frame) {
  return frame.id == cob::sync && !frame.extended && !frame.remote && !frame.error && !frame.fd && frame.size <= 1;
}

/// Time without a SYNC after which it counts as lost: `deadline_ns`, but at least three cycles, so that one lost frame
/// is survived.
constexpr std::int64_t sync_patience_ns(std::int64_t deadline_ns, std::int64_t cycle_us) {
  return std::max(deadline_ns, 3 * 1000 * cycle_us);
}
constexpr std::int64_t default_sync_deadline_ms = 100;

/// Watches that the SYNC keeps coming (2120h; 0: not watched). A stray SYNC is not watched: there must be two within
/// the deadline, or one that took a set point.
class SyncConsumer {
 public:
  explicit SyncConsumer(NodeContext& node)
      : deadline_(node.dictionary.find(od::sync_deadline, 1)),
        cycle_(node.dictionary.find(od::communication_cycle_period, 0)) {}
  void hear(std::int64_t now_ns) {
    watched_ = last_ns_ >= 0 && now_ns - last_ns_ <= patience_ns();
    last_ns_ = now_ns;
  }
  /// The counter of the SYNC that `hear` follows.
  void count(const Frame& frame) {
    counter_.reset();
    if (frame.size == 1) counter_ = frame.data[0];
  }
  std::optional<std::uint8_t> take_counter() { return std::exchange(counter_, std::nullopt); }
  /// The SYNC just heard took a set point.
  void took_set_point() { watched_ = true; }
  void reset() { last_ns_ = -1; }
  /// Whether the deadline has passed; said once, then watched again from the next SYNC on.
  bool lost(std::int64_t now_ns) {
    if (last_ns_ < 0 || deadline_->value == 0 || now_ns - last_ns_ <= patience_ns()) return false;
    last_ns_ = -1;
    return std::exchange(watched_, false);
  }
  /// Next time at which the deadline has passed.
  std::int64_t next_ns() const {
    if (last_ns_ < 0 || deadline_->value == 0) return std::numeric_limits<std::int64_t>::max();
    return last_ns_ + patience_ns() + 1;
  }

 private:
  std::int64_t patience_ns() const { return sync_patience_ns(deadline_->value * ns_per_ms, cycle_->value); }

  const Object *deadline_, *cycle_;
  std::int64_t last_ns_ = -1;
  bool watched_ = false;
  std::optional<std::uint8_t> counter_;
};

}  // namespace tribotwin::hil
