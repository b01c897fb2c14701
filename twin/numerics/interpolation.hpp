#pragma once

#include <algorithm>
#include <cstddef>
#include <span>

namespace tribotwin::twin {

/// A signal at a time: linear between samples, the first and the last one before and after them. `time_s` is strictly
/// increasing, with at least one sample; `values` has its length.
inline double between_samples(std::span<const double> time_s, std::span<const double> values, double at_s) {
  const auto after = static_cast<std::size_t>(std::ranges::upper_bound(time_s, at_s) - time_s.begin());
  if (after == 0) return values.front();
  if (after == time_s.size()) return values.back();
  const double w = (at_s - time_s[after - 1]) / (time_s[after] - time_s[after - 1]);
  return (1 - w) * values[after - 1] + w * values[after];
}

}  // namespace tribotwin::twin
