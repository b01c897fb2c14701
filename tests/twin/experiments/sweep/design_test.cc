#include <algorithm>
#include <cmath>
#include <set>

#include <gtest/gtest.h>

#include <tribotwin/twin/experiments/sweep/design.hpp>

namespace tribotwin::twin::sweep {
namespace {

/// Squared L2 star discrepancy (Warnock 1972).
double discrepancy(const std::vector<double>& u, std::size_t n, std::size_t d) {
  double single = 0, pairs = 0;
  for (std::size_t i = 0; i < n; ++i) {
    double product = 1;
    for (std::size_t k = 0; k < d; ++k) product *= 1 - u[i * d + k] * u[i * d + k];
    single += product;
    for (std::size_t j = 0; j < n; ++j) {
      double both = 1;
      for (std::size_t k = 0; k < d; ++k) both *= 1 - std::max(u[i * d + k], u[j * d + k]);
      pairs += both;
    }
  }
  const auto dims = static_cast<double>(d), points = static_cast<double>(n);
  return std::pow(3, -dims) - std::pow(2, 1 - dims) / points * single + pairs / points / points;
}

/// Number of points in each of `slices` equal parts of a dimension.
std::multiset<std::size_t> counts(const std::vector<double>& u, std::size_t d, std::size_t k, std::size_t slices) {
  std::vector<std::size_t> count(slices);
  for (std::size_t i = k; i < u.size(); i += d) ++count[static_cast<std::size_t>(u[i] * static_cast<double>(slices))];
  return {count.begin(), count.end()};
}

TEST(Design, PointsLieWithinTheCube) {
  for (const auto& [name, type] : design_types)
    if (type != DesignType::grid)
      for (const double u : unit_points(type, 500, 7, 3)) {
        EXPECT_GT(u, 0) << name;
        EXPECT_LT(u, 1) << name;
      }
}

TEST(Design, TheSeedDecides) {
  for (const auto type : {DesignType::latin_hypercube, DesignType::sobol, DesignType::random}) {
    EXPECT_EQ(unit_points(type, 64, 3, 5), unit_points(type, 64, 3, 5));
    EXPECT_NE(unit_points(type, 64, 3, 5), unit_points(type, 64, 3, 6));
  }
}

TEST(Design, MorePointsBeginWithTheSameOnes) {
  for (const auto type : {DesignType::sobol, DesignType::random}) {
    const auto few = unit_points(type, 50, 3, 5), many = unit_points(type, 80, 3, 5);
    EXPECT_TRUE(std::equal(few.begin(), few.end(), many.begin()));
  }
}

TEST(Design, LatinHypercubeHasOnePointPerSlice) {
  for (const std::size_t n : {10u, 37u})
    for (std::size_t k = 0; k < 4; ++k)
      EXPECT_EQ(counts(unit_points(DesignType::latin_hypercube, n, 4, 9), 4, k, n).count(1), n);
}

TEST(Design, SobolIsANet) {
  const std::size_t d = 5, n = 256;
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    const auto u = unit_points(DesignType::sobol, n, d, seed);
    for (std::size_t k = 0; k < d; ++k) EXPECT_EQ(counts(u, d, k, n).count(1), n) << "seed " << seed << " dim " << k;
    // The first two dimensions are a (0, m, 2)-net: one point in every elementary rectangle.
    for (std::size_t a = 1; a <= n; a *= 2) {
      std::set<std::pair<int, int>> hit;
      for (std::size_t i = 0; i < n; ++i)
        hit.emplace(static_cast<int>(u[i * d] * static_cast<double>(a)),
                    static_cast<int>(u[i * d + 1] * static_cast<double>(n / a)));
      EXPECT_EQ(hit.size(), n) << "seed " << seed << " split " << a;
    }
  }
}

TEST(Design, DiscrepancyFallsInTheKnownOrder) {
  const auto of = [](DesignType type) {
    double sum = 0;
    for (std::uint64_t seed = 1; seed <= 8; ++seed) sum += discrepancy(unit_points(type, 256, 4, seed), 256, 4);
    return sum;
  };
  EXPECT_LT(of(DesignType::sobol), of(DesignType::latin_hypercube) / 2);
  EXPECT_LT(of(DesignType::latin_hypercube), of(DesignType::random));
}

TEST(Design, SobolHasItsDimensions) {
  const std::size_t d = sobol_dimensions();
  EXPECT_GE(d, 1000u);
  EXPECT_EQ(unit_points(DesignType::sobol, 2, d, 1).size(), 2 * d);
}

TEST(Design, SaltelliTakesOneGroupFromB) {
  const Saltelli s{.base_points = 2, .column_group = {0, 1, 1}};
  const std::vector<double> ab{.1, .2, .3, .4, .5, .6, .11, .21, .31, .41, .51, .61};
  EXPECT_EQ(s.block(), 4u);
  EXPECT_EQ(s.point(ab, 0), (std::vector{.1, .2, .3}));
  EXPECT_EQ(s.point(ab, 1), (std::vector{.4, .5, .6}));
  EXPECT_EQ(s.point(ab, 2), (std::vector{.4, .2, .3}));
  EXPECT_EQ(s.point(ab, 3), (std::vector{.1, .5, .6}));
  EXPECT_EQ(s.point(ab, 4), (std::vector{.11, .21, .31}));
  EXPECT_TRUE(s.independent(5));
  EXPECT_FALSE(s.independent(6));
}

}  // namespace
}  // namespace tribotwin::twin::sweep
