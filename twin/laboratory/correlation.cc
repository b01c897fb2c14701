#include <tribotwin/twin/laboratory/correlation.hpp>

namespace tribotwin::twin {

Correlation correlation_of(std::span<const double> x) {
  const double n = static_cast<double>(x.size());
  double mean = 0, squares = 0;
  for (const double v : x) mean += v / n;
  for (const double v : x) squares += (v - mean) * (v - mean);
  Correlation c;
  if (!(squares > 0)) return c;
  for (; c.lags < x.size() / 4 && static_cast<double>(c.lags) < 5 * c.samples; ++c.lags) {
    double sum = 0;
    for (std::size_t i = c.lags; i < x.size(); ++i) sum += (x[i] - mean) * (x[i - c.lags] - mean);
    c.samples += 2 * sum / squares;
  }
  return c;
}

}  // namespace tribotwin::twin
