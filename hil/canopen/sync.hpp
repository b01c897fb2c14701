#pragma once

#include <cstdint>
#include <limits>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/node_context.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>

/// SYNC (CiA 301, 7.2.5): frame 080h without data or with a counter of one byte.
namespace tribotwin::hil {

inline bool is_sync(const Frame& frame) {
  return frame.id == cob::sync && !frame.extended && !frame.remote && !frame.error && !frame.fd && frame.size <= 1;
}

/// Watches that the SYNC keeps coming (2120h), from the first one in operational on.
class SyncConsumer {
 public:
  explicit SyncConsumer(NodeContext& node) : deadline_(node.dictionary.find(od::sync_deadline, 1)) {}
  void hear(std::int64_t now_ns) { last_ns_ = now_ns; }
  void reset() { last_ns_ = -1; }
  /// Whether the deadline has passed; said once, then watched again from the next SYNC on.
  bool lost(std::int64_t now_ns) {
    if (last_ns_ < 0 || now_ns - last_ns_ <= deadline_ns()) return false;
    last_ns_ = -1;
    return true;
  }
  /// Next time at which the deadline has passed.
  std::int64_t next_ns() const {
    return last_ns_ < 0 ? std::numeric_limits<std::int64_t>::max() : last_ns_ + deadline_ns() + 1;
  }

 private:
  std::int64_t deadline_ns() const { return deadline_->value * ns_per_ms; }

  const Object* deadline_;
  std::int64_t last_ns_ = -1;
};

}  // namespace tribotwin::hil
