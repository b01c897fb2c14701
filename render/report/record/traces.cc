#include <algorithm>
#include <cmath>
#include <limits>

#include <tribotwin/render/report/record/traces.hpp>

namespace tribotwin::render {

Trace envelope(std::string label, std::span<const double> time, std::span<const double> values) {
  constexpr std::size_t points = 600;
  Trace t{std::move(label), {}, {}};
  const auto keep = [&](std::size_t i) { t.time_s.push_back(time[i]), t.values.push_back(values[i]); };
  const std::size_t n = std::min(time.size(), values.size()), step = n > points ? 2 * n / points + 1 : 1;
  std::size_t last = 0;
  for (std::size_t i = 0; i < n; i += step) {
    std::size_t low = i, high = i;
    for (std::size_t k = i; k < std::min(n, i + step); ++k) {
      if (values[k] < values[low] || std::isnan(values[low])) low = k;
      if (values[k] > values[high] || std::isnan(values[high])) high = k;
    }
    keep(std::min(low, high));
    if (low != high) keep(std::max(low, high));
    last = std::max(low, high);
  }
  if (n > 0 && last != n - 1) keep(n - 1);
  return t;
}

Trace rms_trace(std::string label, std::span<const double> time, std::span<const double> values, double window_s) {
  Trace t{std::move(label), {}, {}};
  const std::size_t n = std::min(time.size(), values.size());
  if (n == 0) return t;
  const double span_s = time[n - 1] - time[0], windows = std::max(1.0, std::round(span_s / window_s)),
               length_s = span_s / windows;
  const auto window_at = [&](double at_s) {
    return length_s > 0 ? std::min(std::floor((at_s - time[0]) / length_s), windows - 1) : 0;
  };
  for (std::size_t i = 0; i < n;) {
    const double window = window_at(time[i]);
    double squares = 0;
    std::size_t count = 0;
    for (; i < n && window_at(time[i]) == window; ++i)
      if (std::isfinite(values[i])) squares += values[i] * values[i], ++count;
    t.time_s.push_back(time[0] + (window + 0.5) * length_s);
    t.values.push_back(count ? std::sqrt(squares / static_cast<double>(count))
                             : std::numeric_limits<double>::quiet_NaN());
  }
  return t;
}

bool any_finite(const Trace& t) {
  return std::ranges::any_of(t.values, [](double v) { return std::isfinite(v); });
}

}  // namespace tribotwin::render
