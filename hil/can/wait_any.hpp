#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <poll.h>

#include <tribotwin/hil/can/transport.hpp>

/// Waiting for several buses at once.
namespace tribotwin::hil {

/// A bus that can be waited for together with others. All transports of open_bus are.
class Pollable {
 public:
  virtual ~Pollable() = default;
  /// Appends what poll(2) has to wait for until a frame may have arrived. Returns the time (CLOCK_MONOTONIC) at which
  /// Transport::wait has to be called at the latest: `deadline_ns`, or earlier for timers and frames already read.
  virtual std::int64_t watch(std::vector<pollfd>& polled, std::int64_t deadline_ns) = 0;
};

/// Transport::wait of all these buses: returns when a frame may have arrived on any of them, at `deadline_ns`, or when
/// a signal arrives. A bus that is not Pollable is asked every millisecond.
void wait_any(std::span<Transport* const> buses, std::int64_t deadline_ns);

}  // namespace tribotwin::hil
