#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>

#include <tribotwin/twin/experiments/sweep/statistics.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>

namespace tribotwin::twin::sweep {
namespace {

double mean_of(std::span<const double> values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

/// Sum of squares about the mean.
double squares_of(std::span<const double> values, double mean) {
  double sum = 0;
  for (const double x : values) sum += (x - mean) * (x - mean);
  return sum;
}

/// The largest k with P(Bin(n, p) < k) <= tail; 0: none.
std::size_t lower_rank(std::size_t n, double p, double tail) {
  const auto count = static_cast<double>(n);
  if (count * p * (1 - p) > 1000) {  // the binomial is normal to a fraction of a rank
    const double rank = count * p - normal_quantile(1 - tail) * std::sqrt(count * p * (1 - p)) + 0.5;
    return rank < 1 ? 0 : static_cast<std::size_t>(rank);
  }
  double below = 0;
  for (std::size_t k = 0; k < n; ++k) {
    const auto x = static_cast<double>(k);
    below += std::exp(std::lgamma(count + 1) - std::lgamma(x + 1) - std::lgamma(count - x + 1) + x * std::log(p) +
                      (count - x) * std::log1p(-p));
    if (below > tail) return k;
  }
  return n;
}

/// Ranks from 1, ties at their mean.
std::vector<double> ranks_of(std::span<const double> values) {
  std::vector<std::size_t> order(values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::sort(order, [&](std::size_t a, std::size_t b) { return values[a] < values[b]; });
  std::vector<double> out(values.size());
  for (std::size_t i = 0, end = 0; i < order.size(); i = end) {
    for (end = i + 1; end < order.size() && values[order[end]] == values[order[i]];) ++end;
    for (std::size_t k = i; k < end; ++k) out[order[k]] = (static_cast<double>(i + end) + 1) / 2;
  }
  return out;
}

/// Whole base points of a design by Saltelli: A, B, then a row per group.
std::vector<std::span<const double>> whole_blocks(std::span<const double> values, std::size_t block) {
  std::vector<std::span<const double>> whole;
  for (std::size_t b = 0; b + block <= values.size(); b += block)
    if (const auto one = values.subspan(b, block); std::ranges::none_of(one, [](double x) { return std::isnan(x); }))
      whole.push_back(one);
  return whole;
}

struct Pair {
  double first, total;
};

/// Variance and mean of A and B together; the mean is taken off, as the estimator of `first` needs (Saltelli 2010).
Pair saltelli_estimate(std::span<const std::span<const double>> blocks, std::size_t group) {
  double sum = 0, square = 0, first = 0, total = 0;
  for (const auto& f : blocks) sum += f[0] + f[1];
  const auto n = static_cast<double>(blocks.size());
  const double mean = sum / (2 * n);
  for (const auto& f : blocks) {
    const double a = f[0] - mean, b = f[1] - mean, ab = f[2 + group] - mean;
    square += a * a + b * b;
    first += b * (ab - a);
    total += (a - ab) * (a - ab);
  }
  const double variance = square / (2 * n - 1);
  return {first / n / variance, total / (2 * n) / variance};
}

Interval percentiles(std::vector<double> values) {
  std::ranges::sort(values);
  const auto at = [&](double p) {
    return values[static_cast<std::size_t>(p * static_cast<double>(values.size() - 1))];
  };
  return {at(0.025), at(0.975)};
}

SobolIndices with_intervals(std::span<const std::span<const double>> blocks, std::size_t group, std::uint64_t seed) {
  constexpr std::size_t resamples = 500;
  std::mt19937_64 random(seed);
  std::vector<double> first, total;
  std::vector<std::span<const double>> drawn(blocks.size());
  for (std::size_t r = 0; r < resamples; ++r) {
    for (auto& one : drawn) one = blocks[static_cast<std::size_t>(random() % blocks.size())];
    const Pair p = saltelli_estimate(drawn, group);
    if (!std::isfinite(p.first) || !std::isfinite(p.total)) continue;
    first.push_back(p.first), total.push_back(p.total);
  }
  const Pair value = saltelli_estimate(blocks, group);
  if (first.size() < resamples / 2) return {{value.first, {}}, {value.total, {}}};
  const auto cut = [](const Interval& i, double high) {
    return Interval{std::clamp(i.low, 0.0, high), std::clamp(i.high, 0.0, high)};
  };
  return {{value.first, cut(percentiles(std::move(first)), 1)},
          {value.total, cut(percentiles(std::move(total)), std::numeric_limits<double>::infinity())}};
}

/// Kurtosis about a mean that is trimmed, so that one far value does not hide itself (Bonett 2006).
double kurtosis_of(std::span<const double> values, double squares) {
  const auto n = static_cast<double>(values.size());
  std::vector<double> ascending(values.begin(), values.end());
  std::ranges::sort(ascending);
  const auto trimmed = static_cast<std::size_t>(n / (2 * std::sqrt(n - 4)));
  const double centre = mean_of(std::span<const double>(ascending).subspan(trimmed, values.size() - 2 * trimmed));
  double fourth = 0;
  for (const double x : values) fourth += std::pow(x - centre, 4);
  return n * fourth / (squares * squares);
}

std::optional<Interval> interval_of_deviation(std::span<const double> values, double squares) {
  if (values.size() < 5 || squares == 0) return {};
  constexpr double z = 1.959963984540054;
  const auto n = static_cast<double>(values.size());
  const double small_sample = n / (n - z), variance = small_sample * squares / (n - 1),
               excess = std::max(0.0, kurtosis_of(values, squares) - (n - 3) / n),
               spread = std::exp(z * small_sample * std::sqrt(excess / (n - 1)));
  return Interval{std::sqrt(variance / spread), std::sqrt(variance * spread)};
}

/// Gaffke (2005), by random weights: those of the values and of one more at the end of the range are the gaps between
/// uniform numbers. For values that are an end or the other, it is Clopper and Pearson's.
Interval interval_on_range(std::span<const double> values, const Range& range) {
  constexpr std::size_t draws = 2000;
  std::mt19937_64 random(values.size());
  std::exponential_distribution<double> gap;
  std::vector<double> low, high;
  for (std::size_t draw = 0; draw < draws; ++draw) {
    const double further = gap(random);
    double weights = further, sum = 0;
    for (const double x : values) {
      const double weight = gap(random);
      weights += weight, sum += weight * x;
    }
    low.push_back((sum + further * range.low) / weights), high.push_back((sum + further * range.high) / weights);
  }
  return {percentiles(std::move(low)).low, percentiles(std::move(high)).high};
}

/// Whether so many values lie at an end of the range that those elsewhere are too few for Student's t.
bool piles_up(std::span<const double> values, const Range& range) {
  constexpr std::ptrdiff_t enough = 20;
  const auto count = std::ssize(values);
  return std::ranges::any_of(std::array{range.low, range.high}, [&](double end) {
    if (!std::isfinite(end)) return false;
    const double rounding = 1e-9 * std::max(1.0, std::abs(end));  // of a time, a sum of samples
    const auto at_end = std::ranges::count_if(values, [&](double x) { return std::abs(x - end) <= rounding; });
    return at_end > 0 && count - at_end < enough;
  });
}

}  // namespace

Moments moments(std::span<const double> values, const Range& range) {
  Moments m{.count = values.size()};
  if (values.empty()) return m;
  const auto [min, max] = std::ranges::minmax(values);
  m.min = min, m.max = max;
  m.mean.value = mean_of(values);
  if (values.size() < 2) return m;
  const double freedom = static_cast<double>(values.size() - 1), squares = squares_of(values, m.mean.value),
               deviation = std::sqrt(squares / freedom),
               half = student_t_quantile(freedom, 0.975) * deviation / std::sqrt(freedom + 1);
  m.deviation.value = deviation;
  if (piles_up(values, range)) {
    if (std::isfinite(range.low) && std::isfinite(range.high)) m.mean.interval = interval_on_range(values, range);
    return m;
  }
  m.mean.interval = {std::max(range.low, m.mean.value - half), std::min(range.high, m.mean.value + half)};
  m.deviation.interval = interval_of_deviation(values, squares);
  return m;
}

Estimated quantile(std::span<const double> ascending, double p) {
  const std::size_t n = ascending.size();
  const double rank = std::clamp(p * (static_cast<double>(n) + 1), 1.0, static_cast<double>(n));
  const auto below = static_cast<std::size_t>(rank);
  const double part = rank - static_cast<double>(below);
  Estimated e{.value = ascending[below - 1], .interval = {}};
  if (part > 0) e.value += part * (ascending[below] - ascending[below - 1]);
  const std::size_t low = lower_rank(n, p, 0.025), high = lower_rank(n, 1 - p, 0.025);
  if (low >= 1 && high >= 1) e.interval = {ascending[low - 1], ascending[n - high]};
  return e;
}

std::optional<Estimated> rank_correlation(std::span<const double> x, std::span<const double> y) {
  if (x.size() < 4) return {};
  const auto a = ranks_of(x), b = ranks_of(y);
  const double mean = (static_cast<double>(x.size()) + 1) / 2, aa = squares_of(a, mean), bb = squares_of(b, mean);
  if (aa == 0 || bb == 0) return {};
  double ab = 0;
  for (std::size_t i = 0; i < a.size(); ++i) ab += (a[i] - mean) * (b[i] - mean);
  const double r = std::clamp(ab / std::sqrt(aa * bb), -1.0, 1.0);
  const double half = 1.959963984540054 * std::sqrt((1 + r * r / 2) / (static_cast<double>(x.size()) - 3));
  const double z = std::atanh(std::clamp(r, -1 + 1e-15, 1 - 1e-15));
  return Estimated{r, Interval{std::tanh(z - half), std::tanh(z + half)}};
}

std::vector<std::optional<SobolIndices>> saltelli_indices(std::span<const double> values, std::size_t groups,
                                                          std::uint64_t seed) {
  std::vector<std::optional<SobolIndices>> all(groups);
  const auto blocks = whole_blocks(values, groups + 2);
  if (blocks.size() < 8) return all;
  std::vector<double> independent;
  for (const auto& f : blocks) independent.insert(independent.end(), {f[0], f[1]});
  const auto [min, max] = std::ranges::minmax(independent);
  if (min == max) return all;
  for (std::size_t g = 0; g < groups; ++g) all[g] = with_intervals(blocks, g, seed + g);
  return all;
}

std::vector<std::optional<SobolIndices>> grid_indices(std::span<const double> values,
                                                      std::span<const std::size_t> levels) {
  std::vector<std::optional<SobolIndices>> all(levels.size());
  if (values.empty() || std::ranges::any_of(values, [](double x) { return std::isnan(x); })) return all;
  const double mean = mean_of(values), whole = squares_of(values, mean);
  const auto [min, max] = std::ranges::minmax(values);
  if (min == max) return all;
  for (std::size_t f = 0, stride = values.size(); f < levels.size(); ++f) {
    const std::size_t outer = stride;  // runs over which the factors from f on vary
    stride /= levels[f];
    const auto n = static_cast<double>(levels[f]), others = static_cast<double>(values.size()) / n;
    std::vector<double> of_level(levels[f], 0.0), of_others(values.size() / levels[f], 0.0);
    for (std::size_t i = 0; i < values.size(); ++i) {
      of_level[i / stride % levels[f]] += values[i] / others;
      of_others[i / outer * stride + i % stride] += values[i] / n;
    }
    all[f] = SobolIndices{.first = {squares_of(of_level, mean) * others / whole, {}},
                          .total = {1 - squares_of(of_others, mean) * n / whole, {}}};
  }
  return all;
}

}  // namespace tribotwin::twin::sweep
