#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include <tribotwin/hil/timing/distribution.hpp>

namespace tribotwin::hil {

/// When SYNCs come and how fast they are answered. Times are CLOCK_REALTIME [ns]: the kernel's stamp of the SYNC.
class SyncTiming {
 public:
  /// A SYNC came while 1006h was `cycle_us`.
  void sync(std::int64_t time_ns, std::int64_t cycle_us) {
    if (last_ns_ > 0) period_.add(time_ns - last_ns_);
    if (first_ns_ == 0) first_ns_ = time_ns;
    last_ns_ = time_ns;
    cycle_us_ = cycle_us;
  }
  /// The last TPDO of the answer to it was sent.
  void answered(std::int64_t time_ns) { latency_.add(time_ns - last_ns_); }

  const Distribution& period() const { return period_; }
  /// From the SYNC to the last TPDO.
  const Distribution& latency() const { return latency_; }
  /// Seconds of the robot per second of SYNCs in lockstep: 1006h by the median period; nothing before a few SYNCs.
  std::optional<double> time_scale() const;
  /// One line where the SYNC is slower than 1006h, so that in lockstep the robot moves in slow motion; else nothing.
  /// Judged once a few SYNCs came.
  std::optional<std::string> slow_motion() const;

 private:
  Distribution period_, latency_;
  std::int64_t first_ns_ = 0, last_ns_ = 0, cycle_us_ = 0;
};

}  // namespace tribotwin::hil
