#pragma once

#include <cstdint>
#include <limits>

#include <tribotwin/hil/timing/distribution.hpp>

namespace tribotwin::hil {

/// The robot's clock in real time: when its steps are due and how late they begin. Times are CLOCK_MONOTONIC [ns].
class Pace {
 public:
  explicit Pace(std::int64_t step_ns) : step_ns_(step_ns) {}

  /// The first step is due one step later; what the program did before it is not late.
  void start(std::int64_t now_ns) { due_ns_ = now_ns + step_ns_; }
  std::int64_t due_ns() const { return due_ns_; }
  /// Whether a step is due; if so it counts as begun now. After a pause of the machine of more than 200 steps the
  /// robot continues from now: it does not catch up.
  bool take(std::int64_t now_ns) {
    const std::int64_t late_ns = now_ns - due_ns_;
    if (late_ns < 0) return false;
    lateness_.add(late_ns);
    if (late_ns > step_ns_) ++overruns_;
    if (late_ns > longest_catch_up_steps * step_ns_) {
      skipped_ns_ += late_ns;
      due_ns_ = now_ns;
    }
    due_ns_ += step_ns_;
    return true;
  }
  /// Of every step.
  const Distribution& lateness() const { return lateness_; }
  /// Steps that began more than a step too late.
  std::uint64_t overruns() const { return overruns_; }
  /// Time that the robot stood still, because it did not catch up.
  std::int64_t skipped_ns() const { return skipped_ns_; }

 private:
  static constexpr std::int64_t longest_catch_up_steps = 200;
  std::int64_t step_ns_, due_ns_ = std::numeric_limits<std::int64_t>::max(), skipped_ns_ = 0;
  Distribution lateness_;
  std::uint64_t overruns_ = 0;
};

}  // namespace tribotwin::hil
