#pragma once

#include <optional>
#include <span>
#include <string>

#include <tribotwin/hil/session/bench.hpp>
#include <tribotwin/hil/timing/pace.hpp>
#include <tribotwin/hil/timing/sync_timing.hpp>

namespace tribotwin::hil {

/// What a session measured on one bus beside the counters of its bench.
struct MeasuredBus {
  std::string address;
  BusCounters counters;
  std::optional<double> bit_rate = {};  ///< [bit/s] of a bus that has one
  const SyncTiming* sync = nullptr;
};

/// The session's JSON: counters of buses, drives and clock; durations in microseconds. Of several buses each has its
/// own counters, in a list. `pace`: of a session in real time.
std::string statistics_json(const Bench& bench, std::span<const MeasuredBus> buses, double wall_s, const Pace* pace);

}  // namespace tribotwin::hil
