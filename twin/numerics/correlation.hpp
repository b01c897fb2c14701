#pragma once

#include <span>

namespace tribotwin::twin {

/// Number of correlated samples, in order of time, per independent one: 1 + 2 sum of the autocorrelations, up to a lag
/// of 5 times this number (and a quarter of all samples). `fitted`: number of parameters that were fitted to the
/// samples, which reduces the correlations. Between 1 and the number of samples.
double samples_per_independent(std::span<const double> x, double fitted = 1);

}  // namespace tribotwin::twin
