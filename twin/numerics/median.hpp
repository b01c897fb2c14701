#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace tribotwin::twin::identification {

/// The middle of at least one value; of an even number the upper of both.
inline double median_of(std::vector<double> x) {
  const auto middle = x.begin() + static_cast<std::ptrdiff_t>(x.size() / 2);
  std::ranges::nth_element(x, middle);
  return *middle;
}

}  // namespace tribotwin::twin::identification
