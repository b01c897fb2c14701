#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include <gtest/gtest.h>

#include <tribotwin/twin/experiments/sweep/design.hpp>
#include <tribotwin/twin/experiments/sweep/statistics.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>

namespace tribotwin::twin::sweep {
namespace {

/// Ishigami, Homma 1990, a = 7, b = 0.1, of a point of the unit cube.
double ishigami(const std::vector<double>& u) {
  const auto x = [&](std::size_t i) { return std::numbers::pi * (2 * u[i] - 1); };
  return std::sin(x(0)) + 7 * std::pow(std::sin(x(1)), 2) + 0.1 * std::pow(x(2), 4) * std::sin(x(0));
}
constexpr double first[] = {0.3139, 0.4424, 0}, total[] = {0.5576, 0.4424, 0.2437};

std::vector<double> ishigami_values(DesignType type, std::size_t base, std::uint64_t seed, const Saltelli& s) {
  const auto ab = unit_points(type, base, 6, seed);
  std::vector<double> values;
  for (std::size_t r = 0; r < base * s.block(); ++r) values.push_back(ishigami(s.point(ab, r)));
  return values;
}

TEST(SobolIndices, OfTheIshigamiFunction) {
  const Saltelli s{.base_points = 1024, .column_group = {0, 1, 2}};
  constexpr int seeds = 20;
  double mean_first[3] = {}, mean_total[3] = {};
  for (int seed = 1; seed <= seeds; ++seed) {
    const auto found = saltelli_indices(ishigami_values(DesignType::sobol, 1024, seed, s), 3, seed);
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_NEAR(found[i]->first.value, first[i], 0.05) << i << " seed " << seed;
      EXPECT_NEAR(found[i]->total.value, total[i], 0.05) << i << " seed " << seed;
      mean_first[i] += found[i]->first.value / seeds, mean_total[i] += found[i]->total.value / seeds;
    }
  }
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(mean_first[i], first[i], 0.005) << i;
    EXPECT_NEAR(mean_total[i], total[i], 0.005) << i;
  }
}

TEST(SobolIndices, IntervalsHoldTheTruth) {
  const Saltelli s{.base_points = 256, .column_group = {0, 1, 2}};
  int held = 0, all = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    const auto found = saltelli_indices(ishigami_values(DesignType::random, 256, seed, s), 3, seed);
    for (std::size_t i = 0; i < 3; ++i)
      for (const auto& [e, truth] : {std::pair{found[i]->first, first[i]}, {found[i]->total, total[i]}})
        held += e.interval->low <= truth && truth <= e.interval->high, ++all;
  }
  EXPECT_GE(held, 0.91 * all);
  EXPECT_LE(held, 0.99 * all);
}

TEST(SobolIndices, AFailedRunCostsItsBasePoint) {
  const Saltelli s{.base_points = 64, .column_group = {0, 1, 2}};
  auto values = ishigami_values(DesignType::sobol, 64, 1, s);
  const std::vector<double> rest(values.begin() + 5, values.end());
  values[3] = std::numeric_limits<double>::quiet_NaN();
  const auto with = saltelli_indices(values, 3, 1), without = saltelli_indices(rest, 3, 1);
  EXPECT_EQ(with[0]->first.value, without[0]->first.value);
  EXPECT_FALSE(saltelli_indices(std::vector<double>(320, 4.0), 3, 1)[0]) << "a constant has no indices";
}

/// y = a + 2 b + 2 a b on levels -1, 1 of a and -1, 0, 1 of b: variances 1, 4 x 2/3, 4 x 2/3.
TEST(SobolIndices, OfAFullGrid) {
  std::vector<double> values;
  for (const double a : {-1.0, 1.0})
    for (const double b : {-1.0, 0.0, 1.0}) values.push_back(a + 2 * b + 2 * a * b);
  const std::size_t levels[] = {2, 3};
  const auto found = grid_indices(values, levels);
  const double whole = 1 + 16.0 / 3;
  EXPECT_NEAR(found[0]->first.value, 1 / whole, 1e-12);
  EXPECT_NEAR(found[0]->total.value, (1 + 8.0 / 3) / whole, 1e-12);
  EXPECT_NEAR(found[1]->first.value, 8.0 / 3 / whole, 1e-12);
  EXPECT_NEAR(found[1]->total.value, 16.0 / 3 / whole, 1e-12);
  values[2] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(grid_indices(values, levels)[0]);
}

TEST(Quantile, ContainsAFurtherValueWithItsProbability) {
  const std::vector<double> ascending{1, 2, 3, 4, 5, 6, 7, 8, 9};  // of 9 values: i / 10
  EXPECT_DOUBLE_EQ(quantile(ascending, 0.1).value, 1);
  EXPECT_DOUBLE_EQ(quantile(ascending, 0.55).value, 5.5);
  EXPECT_DOUBLE_EQ(quantile(ascending, 0.01).value, 1) << "no further than the sample";
  EXPECT_FALSE(quantile(ascending, 0.1).interval) << "nine values bound no 10 % quantile from below";
}

/// Share of 95 % intervals that hold the truth, over many samples of an exponential distribution.
TEST(Intervals, HoldTheTruth) {
  struct Case {
    const char* name;
    double truth;
    std::function<Interval(std::vector<double>)> of;
    double low, high;
  };
  const auto ranked = [](std::vector<double> v, double p) {
    std::ranges::sort(v);
    return *quantile(v, p).interval;
  };
  const Case cases[] = {
      {"mean", 1, [](std::vector<double> v) { return *moments(v).mean.interval; }, 0.93, 0.97},
      {"median", std::log(2), [&](std::vector<double> v) { return ranked(v, 0.5); }, 0.945, 0.985},
      {"90 %", std::log(10), [&](std::vector<double> v) { return ranked(v, 0.9); }, 0.945, 0.985},
  };
  for (const Case& c : cases) {
    int held = 0;
    for (std::uint64_t seed = 1; seed <= 2000; ++seed) {
      auto sample = unit_points(DesignType::random, 150, 1, seed);
      for (double& x : sample) x = -std::log(x);
      const Interval i = c.of(sample);
      held += i.low <= c.truth && c.truth <= i.high;
    }
    EXPECT_GE(held, c.low * 2000) << c.name;
    EXPECT_LE(held, c.high * 2000) << c.name;
  }
}

/// Times above a threshold, in a run of 10 s: 0 in most runs, where few exceed it. The mean by simulation of 10^7.
TEST(Intervals, OfATimeLieInTheRunAndHoldTheTruth) {
  struct Case {
    double threshold, truth;  ///< in standard deviations
    double narrowest;         ///< share that must hold it
  };
  const Range run{0, 10};
  for (const std::size_t n : {16u, 40u, 150u})
    for (const Case& c : {Case{-0.5, 0.69780, 0.92}, {0.5, 0.19780, 0.92}, {1.3, 0.04553, 0.92}, {2, 0.00849, 0.92}}) {
      int held = 0;
      for (std::uint64_t seed = 1; seed <= 300; ++seed) {
        auto sample = unit_points(DesignType::random, n, 1, seed);
        for (double& x : sample) x = std::max(0.0, normal_quantile(x) - c.threshold);
        const Interval i = *moments(sample, run).mean.interval;
        EXPECT_GE(i.low, 0);
        EXPECT_LE(i.high, 10);
        held += i.low <= c.truth && c.truth <= i.high;
      }
      EXPECT_GE(held, c.narrowest * 300) << n << " runs, threshold " << c.threshold;
    }
}

TEST(Intervals, OfAShareAreThoseOfClopperAndPearson) {
  std::vector<double> values(20, 0.0);
  values[3] = values[8] = values[9] = 1;
  const Interval i = *moments(values, {0, 1}).mean.interval;
  EXPECT_NEAR(i.low, 0.0321, 0.003);  // R: binom.test(3, 20)
  EXPECT_NEAR(i.high, 0.3789, 0.01);
  std::ranges::fill(values, 0.0);
  const Interval none = *moments(values, {0, 1}).mean.interval;
  EXPECT_EQ(none.low, 0);
  EXPECT_NEAR(none.high, 1 - std::pow(0.025, 1.0 / 20), 0.01) << "20 runs that never exceed it say no more";
  EXPECT_FALSE(moments(values, {.low = 0}).mean.interval) << "nobody knows how much the next one is";
}

TEST(Intervals, OfAnIndexLieBetweenNoneAndAll) {
  const Saltelli s{.base_points = 64, .column_group = {0, 1, 2}};
  for (std::uint64_t seed = 1; seed <= 20; ++seed)
    for (const auto& found : saltelli_indices(ishigami_values(DesignType::random, 64, seed, s), 3, seed))
      for (const auto& e : {found->first, found->total}) EXPECT_GE(e.interval->low, 0);
}

/// Of any distribution, not of normal values alone.
TEST(Intervals, OfTheDeviationHoldTheTruth) {
  const std::pair<const char*, std::function<double(double)>> cases[] = {
      {"normal", normal_quantile},
      {"uniform", [](double u) { return u * std::sqrt(12.0); }},
      {"exponential", [](double u) { return -std::log(u); }}};
  for (const auto& [name, value] : cases) {
    int held = 0;
    for (std::uint64_t seed = 1; seed <= 1000; ++seed) {
      auto sample = unit_points(DesignType::random, 300, 1, seed);
      for (double& x : sample) x = value(x);
      const Interval i = *moments(sample).deviation.interval;
      held += i.low <= 1 && 1 <= i.high;
    }
    EXPECT_GE(held, 920) << name;
    EXPECT_LE(held, 975) << name;
  }
}

TEST(Intervals, OfTheDeviationAndOfRankCorrelationsHoldTheTruth) {
  int deviation = 0, correlation = 0;
  const double r = 0.6, of_ranks = 6 / std::numbers::pi * std::asin(r / 2);
  for (std::uint64_t seed = 1; seed <= 2000; ++seed) {
    const auto u = unit_points(DesignType::random, 60, 2, seed);
    std::vector<double> x, y;
    for (std::size_t i = 0; i < u.size(); i += 2) {
      x.push_back(normal_quantile(u[i]));
      y.push_back(r * x.back() + std::sqrt(1 - r * r) * normal_quantile(u[i + 1]));
    }
    const auto d = *moments(x).deviation.interval, c = *rank_correlation(x, y)->interval;
    deviation += d.low <= 1 && 1 <= d.high;
    correlation += c.low <= of_ranks && of_ranks <= c.high;
  }
  EXPECT_NEAR(deviation / 2000.0, 0.95, 0.02);
  EXPECT_NEAR(correlation / 2000.0, 0.95, 0.02);
}

TEST(RankCorrelation, KnowsTiesAndConstants) {
  const std::vector<double> x{1, 2, 3, 4, 5}, y{1, 8, 27, 64, 125}, tied{1, 1, 2, 2, 3}, constant(5, 2.0);
  EXPECT_DOUBLE_EQ(rank_correlation(x, y)->value, 1);
  EXPECT_NEAR(rank_correlation(x, tied)->value, 0.9486832980505138, 1e-12);  // scipy.stats.spearmanr
  EXPECT_FALSE(rank_correlation(x, constant));
}

}  // namespace
}  // namespace tribotwin::twin::sweep
