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
///
/// A SYNC slower than the deadline is watched as well, from the third one on, if it is a cycle: up to one second long,
/// and steady, the longer of two periods at most twice the shorter. It is lost after three of the longer one.
class SyncConsumer {
 public:
  explicit SyncConsumer(NodeContext& node)
      : deadline_(node.dictionary.find(od::sync_deadline, 1)),
        cycle_(node.dictionary.find(od::communication_cycle_period, 0)) {}
  void hear(std::int64_t now_ns) {
    const bool first = last_ns_ < 0;
    const std::int64_t period_ns = first ? 0 : now_ns - last_ns_;
    const auto [shorter, longer] = std::minmax({period_ns, std::exchange(period_ns_, period_ns)});
    const bool slow = period_ns > deadline_ns() && longer <= slowest_cycle_ns && longer <= 2 * shorter;
    watched_ = slow || (!first && period_ns <= deadline_ns());  // 0: frames of one turn have one time stamp
    slow_ns_ = slow ? 3 * longer : 0;
    last_ns_ = now_ns;
  }
  /// The counter of the SYNC that `hear` follows.
  void count(const Frame& frame) {
    counter_.reset();
    if (frame.size == 1) counter_ = frame.data[0];
  }
  std::optional<std::uint8_t> take_counter() { return std::exchange(counter_, std::nullopt); }
  /// The SYNC just heard took a set point.
  void took_set_point() {
    watched_ = true;
    slow_ns_ = 0;
  }
  void reset() {
    last_ns_ = -1;
    period_ns_ = slow_ns_ = 0;
    watched_ = false;
  }
  /// Whether the deadline has passed; said once, then watched anew.
  bool lost(std::int64_t now_ns) {
    if (!watching() || now_ns - last_ns_ <= patience_ns()) return false;
    reset();
    return true;
  }
  /// Next time at which the deadline has passed.
  std::int64_t next_ns() const {
    if (!watching()) return std::numeric_limits<std::int64_t>::max();
    return last_ns_ + patience_ns() + 1;
  }

 private:
  static constexpr std::int64_t slowest_cycle_ns = 1000 * ns_per_ms;

  bool watching() const { return watched_ && deadline_->value != 0; }
  std::int64_t deadline_ns() const { return sync_patience_ns(deadline_->value * ns_per_ms, cycle_->value); }
  std::int64_t patience_ns() const { return std::max(deadline_ns(), slow_ns_); }

  const Object *deadline_, *cycle_;
  std::int64_t last_ns_ = -1, period_ns_ = 0;
  std::int64_t slow_ns_ = 0;  ///< patience with a SYNC slower than the deadline; 0: it is not
  bool watched_ = false;
  std::optional<std::uint8_t> counter_;
};

}  // namespace tribotwin::hil
