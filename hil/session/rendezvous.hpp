#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

namespace tribotwin::hil {

/// Which SYNCs of several buses are one cycle of the robot in lockstep: the cycle ends when each bus had its SYNC. A
/// bus that was given up is not waited for until its next SYNC. Times are CLOCK_MONOTONIC [ns], those at which the
/// SYNCs came.
class Rendezvous {
 public:
  explicit Rendezvous(std::size_t buses) : buses_(buses) {}

  /// Whether this bus had its SYNC of the cycle and another one has not: its next SYNC has to wait.
  bool waits(std::size_t bus) const { return buses_[bus].came; }

  /// The SYNC of a bus that does not wait. Returns whether it was the last that was missing; end_cycle() follows.
  bool arrive(std::size_t bus, std::int64_t came_ns) {
    Bus& b = buses_[bus];
    if (begun_ns_ < 0) begun_ns_ = came_ns;
    b.given_up = false;
    b.last_ns = came_ns;
    if (none() && belongs_to_last(bus, came_ns)) return false;
    if (none()) first_ = bus, first_ns_ = came_ns;
    b.came = true;
    if (!std::ranges::all_of(buses_, [](const Bus& one) { return one.came || one.given_up; })) return false;
    last_first_ = first_;
    last_wait_ns_ = came_ns - first_ns_;
    last_end_ns_ = came_ns;
    return true;
  }

  /// The robot moves on, whichever SYNC is missing.
  void end_cycle() {
    for (Bus& b : buses_) b.came = false;
  }
  /// Buses whose SYNC is missing are not waited for again.
  void give_up() {
    for (Bus& b : buses_) b.given_up = b.given_up || !b.came;
  }
  /// When a bus whose SYNC is missing had its last one, or the first SYNC came at all.
  std::int64_t missing_since_ns() const {
    std::int64_t since_ns = begun_ns_;
    for (const Bus& b : buses_)
      if (!b.came && !b.given_up) since_ns = std::max(since_ns, b.last_ns);
    return since_ns;
  }

 private:
  struct Bus {
    bool came = false, given_up = false;
    std::int64_t last_ns = -1;
  };
  static constexpr int sure_cycles = 8;

  bool none() const {
    return std::ranges::none_of(buses_, [](const Bus& b) { return b.came; });
  }

  /// A lost SYNC leaves the buses one cycle apart: the one that waited for the whole cycle has its next SYNC beside the
  /// one that it waited for. After a few such cycles in a row that next SYNC counts for the cycle that has just ended.
  bool belongs_to_last(std::size_t bus, std::int64_t came_ns) {
    const std::int64_t distance_ns = came_ns > last_end_ns_ ? came_ns - last_end_ns_ : last_end_ns_ - came_ns;
    apart_ = bus == last_first_ && distance_ns < last_wait_ns_ / 4 ? apart_ + 1 : 0;
    if (apart_ < sure_cycles) return false;
    apart_ = 0;
    return true;
  }

  std::vector<Bus> buses_;
  std::size_t first_ = 0, last_first_ = 0;
  std::int64_t begun_ns_ = -1, first_ns_ = 0, last_end_ns_ = 0, last_wait_ns_ = 0;
  int apart_ = 0;
};

}  // namespace tribotwin::hil
