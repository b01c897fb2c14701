#include <fmt/format.h>

#include <tribotwin/hil/timing/sync_timing.hpp>

namespace tribotwin::hil {

std::optional<double> SyncTiming::time_scale() const {
  constexpr std::uint64_t many = 50, few = 5;
  constexpr std::int64_t long_ns = 2'000'000'000;
  const bool enough = period_.count() >= many || (period_.count() >= few && last_ns_ - first_ns_ >= long_ns);
  const std::int64_t median_ns = enough ? period_.median_ns() : 0;
  if (median_ns <= 0) return std::nullopt;
  return 1e3 * static_cast<double>(cycle_us_) / static_cast<double>(median_ns);
}

std::optional<std::string> SyncTiming::slow_motion() const {
  constexpr double usual_scatter = 1.2;
  const auto scale = time_scale();
  if (!scale || *scale * usual_scatter > 1) return std::nullopt;
  return fmt::format(
      "the SYNC comes every {:.3g} ms, 1006h says {:.3g} ms: the robot moves at {:.2g} of real time; set 1006h or "
      "--cycle to the period of the SYNC, or use --realtime",
      1e-6 * static_cast<double>(period_.median_ns()), 1e-3 * static_cast<double>(cycle_us_), *scale);
}

}  // namespace tribotwin::hil
