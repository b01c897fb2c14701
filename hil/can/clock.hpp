#pragma once

#include <cstdint>

#include <time.h>

namespace tribotwin::hil {

/// A clock of the system [ns]; CLOCK_MONOTONIC is the one of deadlines.
inline std::int64_t clock_ns(clockid_t clock = CLOCK_MONOTONIC) {
  timespec t{};
  clock_gettime(clock, &t);
  return t.tv_sec * std::int64_t{1'000'000'000} + t.tv_nsec;
}

}  // namespace tribotwin::hil
