#pragma once

#include <cstdint>
#include <optional>

#include <tribotwin/hil/can/frame.hpp>
#include <tribotwin/hil/shadow/channel.hpp>

namespace tribotwin::hil {

/// Times of a session's frames from its first one on, by their stamps. In lockstep the SYNC is the clock instead: each
/// moves the time on by one cycle, whatever the stamps say.
class BusClock {
 public:
  /// `lockstep_cycle_s`: the time from one SYNC to the next in lockstep; none: by the stamps.
  explicit BusClock(std::optional<double> lockstep_cycle_s) : lockstep_cycle_s_(lockstep_cycle_s) {}

  /// The next frame. A clock that was set back does not take the session's time back.
  void hear(const Frame& frame, bool sync) {
    if (first_) last_ns_ = frame.time_ns;
    first_ = false;
    elapsed_ns_ += frame.time_ns > last_ns_ ? frame.time_ns - last_ns_ : 0;
    last_ns_ = frame.time_ns;
    if (!sync) return;
    ++cycle_;
    previous_sync_s_ = sync_s_;
    sync_s_ = lockstep_cycle_s_ ? static_cast<double>(cycle_) * *lockstep_cycle_s_ : stamped_s();
  }
  /// Of the frame last heard, by its stamp.
  double stamped_s() const { return 1e-9 * static_cast<double>(elapsed_ns_); }
  double now_s() const { return lockstep_cycle_s_ ? sync_s_ : stamped_s(); }
  bool synced() const { return cycle_ >= 0; }

  /// Of the frame last heard: that of its SYNC, if it comes with one.
  Stamp stamp(Sending sending) const {
    if (sending == Sending::with_sync && synced()) return {sync_s_, cycle_, previous_sync_s_};
    return {now_s(), -1, 0};
  }

 private:
  std::optional<double> lockstep_cycle_s_;
  bool first_ = true;
  std::int64_t last_ns_ = 0, elapsed_ns_ = 0, cycle_ = -1;
  double sync_s_ = 0, previous_sync_s_ = 0;
};

}  // namespace tribotwin::hil
