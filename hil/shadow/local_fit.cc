#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <tribotwin/hil/shadow/local_fit.hpp>

namespace tribotwin::hil {
namespace {

constexpr std::size_t least_samples = 5;

struct Window {
  Samples::const_iterator begin, end;
  std::size_t size() const { return static_cast<std::size_t>(end - begin); }
};

Window window(const Samples& samples, double time_s, double half_s) {
  const double margin = 1e-9;  // a window of whole cycles has its end samples, whatever the rounding
  return {std::ranges::lower_bound(samples, time_s - half_s - margin, {}, &Sample::middle_s),
          std::ranges::upper_bound(samples, time_s + half_s + margin, {}, &Sample::middle_s)};
}

double scaled(const Sample& sample, double time_s, double half_s) { return (sample.middle_s() - time_s) / half_s; }

/// Solves A x = b for the symmetric A of a polynomial's normal equations: a[i + j] = sum w s^(i+j). Pivots are positive
/// because a covered window has samples at more than `n` times.
template <std::size_t n>
std::array<double, n> solved(const std::array<double, 2 * n - 1>& moments, std::array<double, n> b) {
  std::array<std::array<double, n>, n> a;
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < n; ++j) a[i][j] = moments[i + j];
  for (std::size_t k = 0; k < n; ++k)
    for (std::size_t i = k + 1; i < n; ++i) {
      const double factor = a[i][k] / a[k][k];
      for (std::size_t j = k; j < n; ++j) a[i][j] -= factor * a[k][j];
      b[i] -= factor * b[k];
    }
  for (std::size_t k = n; k-- > 0;) {
    for (std::size_t j = k + 1; j < n; ++j) b[k] -= a[k][j] * b[j];
    b[k] /= a[k][k];
  }
  return b;
}

/// Coefficients of the polynomial in s that fits `values` about `origin`; weight(i, s) of the i-th sample.
template <std::size_t n, class Weight>
std::array<double, n> fitted(const Window& w, double time_s, double half_s, double origin, const Weight& weight) {
  std::array<double, 2 * n - 1> moments{};
  std::array<double, n> b{};
  std::size_t i = 0;
  for (auto sample = w.begin; sample != w.end; ++sample, ++i) {
    const double s = scaled(*sample, time_s, half_s), value = sample->value - origin;
    double power = weight(i, s);
    for (std::size_t k = 0; k < moments.size(); ++k, power *= s) {
      moments[k] += power;
      if (k < n) b[k] += power * value;
    }
  }
  return solved<n>(moments, b);
}

double at(const std::array<double, 3>& c, double s) { return c[0] + s * (c[1] + s * c[2]); }

/// Tukey's biweight of the distances from the parabola, cut at six medians.
std::vector<double> robust_weights(const Window& w, double time_s, double half_s, double origin,
                                   const std::array<double, 3>& c, double resolution) {
  std::vector<double> weights;
  weights.reserve(w.size());
  for (auto sample = w.begin; sample != w.end; ++sample)
    weights.push_back(std::abs(sample->value - origin - at(c, scaled(*sample, time_s, half_s))));
  std::vector<double> sorted = weights;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  const double cut = 6 * std::max(*middle, resolution);
  for (double& x : weights) x = x < cut ? std::pow(1 - x * x / (cut * cut), 2) : 0;
  return weights;
}

}  // namespace

bool covered(const Samples& samples, double time_s, double half_s, double gap_s) {
  const Window w = window(samples, time_s, half_s);
  if (w.size() < least_samples) return false;
  double last_s = time_s - half_s;
  for (auto sample = w.begin; sample != w.end; ++sample) {
    if (sample->middle_s() - last_s > gap_s) return false;
    last_s = sample->middle_s();
  }
  return time_s + half_s - last_s <= gap_s;
}

Motion local_motion(const Samples& samples, double time_s, double half_s, double resolution) {
  const Window w = window(samples, time_s, half_s);
  const double origin = w.begin->value;
  auto c = fitted<3>(w, time_s, half_s, origin, [](std::size_t, double) { return 1.0; });
  for (int pass = 0; pass < 2; ++pass) {
    const auto weights = robust_weights(w, time_s, half_s, origin, c, resolution);
    if (std::ranges::count_if(weights, [](double x) { return x > 0; }) < static_cast<int>(least_samples)) break;
    c = fitted<3>(w, time_s, half_s, origin, [&](std::size_t i, double) { return weights[i]; });
  }
  return {origin + c[0], c[1] / half_s, 2 * c[2] / (half_s * half_s)};
}

double local_mean(const Samples& samples, double time_s, double half_s) {
  const Window w = window(samples, time_s, half_s);
  const double origin = w.begin->value;
  const auto weight = [&](std::size_t i, double s) {
    const double rest = std::max(0.0, 1 - s * s), span_s = w.begin[static_cast<std::ptrdiff_t>(i)].span_s;
    return rest * rest * (span_s > 0 ? span_s / half_s : 1);
  };
  return origin + fitted<2>(w, time_s, half_s, origin, weight)[0];
}

void forget_before(Samples& samples, double time_s) {
  while (!samples.empty() && samples.front().time_s < time_s) samples.pop_front();
}

}  // namespace tribotwin::hil
