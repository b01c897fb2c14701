#pragma once

#include <optional>
#include <string>

#include <tribotwin/hil/session/bench.hpp>
#include <tribotwin/hil/timing/pace.hpp>
#include <tribotwin/hil/timing/sync_timing.hpp>

namespace tribotwin::hil {

/// What a session measured beside the counters of its bench.
struct SessionTiming {
  double wall_s = 0;
  std::optional<double> bit_rate = {};  ///< [bit/s] of a bus that has one
  const SyncTiming* sync = nullptr;
  const Pace* pace = nullptr;  ///< of a session in real time
};

/// The session's JSON: counters of bus, drives and clock; durations in microseconds.
std::string statistics_json(const Bench& bench, const BusCounters& bus, const SessionTiming& timing);

}  // namespace tribotwin::hil
