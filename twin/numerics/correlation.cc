#include <algorithm>
#include <cstddef>

#include <tribotwin/twin/numerics/correlation.hpp>

namespace tribotwin::twin {

double samples_per_independent(std::span<const double> x, double fitted) {
  const double n = static_cast<double>(x.size());
  double mean = 0, variance = 0, c = 1;
  for (const double v : x) mean += v / n;
  for (const double v : x) variance += (v - mean) * (v - mean) / n;
  if (!(variance > 0)) return 1;
  std::size_t lag = 1;
  for (; lag < x.size() / 4 && static_cast<double>(lag) < 5 * c; ++lag) {
    double sum = 0;
    for (std::size_t i = lag; i < x.size(); ++i) sum += (x[i] - mean) * (x[i - lag] - mean);
    c += 2 * sum / (n * variance);
  }
  c /= std::max(0.2, 1 - fitted * static_cast<double>(2 * lag - 1) / n);
  return std::clamp(c, 1.0, std::max(1.0, n));
}

}  // namespace tribotwin::twin
