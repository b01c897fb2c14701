#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>

#include <tribotwin/hil/canopen/node_context.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/canopen/pdo.hpp>

namespace tribotwin::hil {

/// Watches that the set points of the active mode keep coming, from the first one that an RPDO brings to an enabled
/// drive (2121h: cycles without one; 0: not watched). A mode that needs its set point only once is watched from then on
/// that the master has brought it with as many SYNCs in a row as it may then be missing.
///
/// It counts SYNCs, so that a slow master in lockstep is not late. An event-driven RPDO is no part of the SYNC's cycle;
/// it has at least 100 ms, and is watched by the clock, too. An RPDO with a deadline of its own (140xh:05) is left to
/// that.
class SetPointWatch {
 public:
  explicit SetPointWatch(NodeContext& node)
      : deadline_(node.dictionary.find(od::set_point_deadline, 1)),
        cycle_(node.dictionary.find(od::communication_cycle_period, 0)) {}

  /// The object that holds the set point now; 0: the drive follows none. Another one is not watched yet. `cyclic`: the
  /// mode needs it again and again. `made_up`: the drive has set it itself, in motion; then the watch of the object
  /// before goes on, or the motion would belong to nobody.
  void follow(std::uint16_t target, bool cyclic, bool made_up) {
    if (target != target_) {
      held_over_ = made_up && delivery_.exists ? target_ : std::uint16_t{0};
      if (held_over_ == 0) delivery_ = {};
      in_a_row_ = 0;
    }
    if (held_over_ != 0 && !made_up) held_over_ = 0, delivery_ = {};
    target_ = target;
    cyclic_ = cyclic || held_over_ != 0;
  }
  /// The object of the mode before, whose set points keep a motion alive that the drive made up; 0: none.
  std::uint16_t held_over() const { return held_over_; }
  void arrived(const PdoDelivery& delivery, std::int64_t now_ns) {
    const bool next = delivery.every_syncs > 0 && syncs_ <= delivery.every_syncs;
    in_a_row_ = next ? in_a_row_ + 1 : 0;
    delivery_ = cyclic_ || in_a_row_ >= deadline_->value ? delivery : PdoDelivery{};
    restart(now_ns);
  }
  /// Counts from now on.
  void restart(std::int64_t now_ns) {
    syncs_ = 0;
    last_ns_ = now_ns;
  }
  void sync() { ++syncs_; }

  /// Whether the deadline has passed; said once, then watched again from the next arrival on.
  bool lost(std::int64_t now_ns) {
    if (!watching()) return false;
    const bool late = syncs_ > syncs_allowed() || (delivery_.every_syncs == 0 && now_ns - last_ns_ > patience_ns());
    if (late) delivery_ = {};
    return late;
  }
  /// Next time at which `lost` may say so without a SYNC.
  std::int64_t next_ns() const {
    if (!watching() || delivery_.every_syncs != 0) return std::numeric_limits<std::int64_t>::max();
    return last_ns_ + patience_ns() + 1;
  }

 private:
  static constexpr std::int64_t shortest_ns = 100 * ns_per_ms;

  bool watching() const { return delivery_.exists && !delivery_.own_deadline && deadline_->value != 0; }
  std::int64_t cycle_ns() const { return std::max<std::int64_t>(1, cycle_->value) * 1000; }
  std::int64_t patience_ns() const { return std::max(deadline_->value * cycle_ns(), shortest_ns); }
  std::int64_t syncs_allowed() const {
    return delivery_.every_syncs ? deadline_->value * delivery_.every_syncs : patience_ns() / cycle_ns();
  }

  const Object *deadline_, *cycle_;
  std::uint16_t target_ = 0, held_over_ = 0;
  bool cyclic_ = true;
  std::int64_t in_a_row_ = 0;  ///< set points that came with consecutive SYNCs of their RPDO
  PdoDelivery delivery_;
  std::int64_t syncs_ = 0, last_ns_ = 0;
};

}  // namespace tribotwin::hil
