#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace tribotwin::twin::identification {

/// Median of at least one value; for an even number the upper of the two middle ones.
inline double median_of(std::vector<double> x) {
  const auto middle = x.begin() + static_cast<std::ptrdiff_t>(x.size() / 2);
  std::ranges::nth_element(x, middle);
  return *middle;
}

}  // namespace tribotwin::twin::identification
