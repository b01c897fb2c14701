#pragma once

#include <cstdint>

#include <tribotwin/hil/shadow/cycle_period.hpp>
#include <tribotwin/hil/shadow/local_fit.hpp>

namespace tribotwin::hil {

/// How often a frame comes: with every n-th SYNC, with a period of its own, or when something changes.
enum class Sending { with_sync, periodic, on_change };

/// The SYNC that a value was sampled at, or the time of its frame.
struct Stamp {
  double time_s = 0;
  std::int64_t cycle = -1;  ///< number of the SYNC; -1: no SYNC
  double previous_s = 0;    ///< time of the SYNC before
};

/// The samples of one quantity of one joint, and how many are missing among them.
class Channel {
 public:
  /// A value that was heard. `every`: of how many SYNCs one brings it, at least 1.
  /// `span_s`: > 0 where it is the mean over this time up to the stamp.
  void add(const Stamp& stamp, double value, Sending sending, int every, double span_s = 0);
  /// A cycle at `time_s` in which nothing was heard: a value that is sent on change only still holds, for `longest_s`.
  void hold(double time_s, double longest_s);

  const Samples& samples() const { return samples_; }
  void forget_before(double time_s) { hil::forget_before(samples_, time_s); }
  std::uint64_t heard() const { return heard_; }
  std::uint64_t lost() const { return static_cast<std::uint64_t>(lost_); }
  double heard_s() const { return heard_s_; }  ///< time of the last value that was heard

 private:
  void count_lost(std::int64_t missing);
  Samples samples_;
  CyclePeriod period_;
  Sending sending_ = Sending::periodic;
  std::int64_t cycle_ = -1, lost_ = 0;
  std::uint64_t heard_ = 0;
  double heard_s_ = 0;
};

}  // namespace tribotwin::hil
