#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

namespace tribotwin::twin::identification {

/// Median of at least one value; for an even number the upper of the two middle ones.
inline double median_of(std::vector<double> x) {
  const auto middle = x.begin() + static_cast<std::ptrdiff_t>(x.size() / 2);
  std::ranges::nth_element(x, middle);
  return *middle;
}

/// Median of the differences of ascending values; 0 for fewer than two.
inline double median_step(std::span<const double> ascending) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < ascending.size(); ++i) steps.push_back(ascending[i] - ascending[i - 1]);
  return steps.empty() ? 0 : median_of(std::move(steps));
}

}  // namespace tribotwin::twin::identification
