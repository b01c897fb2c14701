#pragma once

#include <span>

namespace tribotwin::twin {

/// How many samples, in order of time, are worth one independent one: 1 + 2 sum of their autocorrelations, up to 5 of
/// these apart (and a quarter of all). `fitted` parameters were fitted to the samples, which took as much out of the
/// correlations. Between 1 and the number of samples.
double samples_per_independent(std::span<const double> x, double fitted = 1);

}  // namespace tribotwin::twin
