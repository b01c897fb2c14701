#pragma once

#include <cstddef>
#include <span>

namespace tribotwin::twin {

struct Correlation {
  double samples = 1;      ///< how many correlated samples are worth one independent; may be below 1 where neighbours differ in sign
  std::size_t lags = 1;    ///< up to which autocorrelations were summed, exclusive
};

/// c = 1 + 2 sum of the autocorrelations of values in order of time, up to 5 c samples (and a quarter of all) apart.
Correlation correlation_of(std::span<const double> x);

}  // namespace tribotwin::twin
