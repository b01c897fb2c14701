// False discoveries and power over synthetic plants. TRIBOTWIN_PLANTS=100 TRIBOTWIN_FIRST_SEED=71001 for the figures
// of the README.
#include <cstdlib>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/tests/twin/diagnosis/fleet/plant.hpp>
#include <tribotwin/twin/diagnosis/fleet/judge.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

/// A whole number from the environment.
unsigned number(const char* name, unsigned otherwise) {
  const char* given = std::getenv(name);
  return given ? static_cast<unsigned>(std::atoi(given)) : otherwise;
}

TypeModel learned(const Plant& plant) {
  const auto type = learn_type([&](const auto& visit) {
    for (const auto& j : plant.joints) visit(j.healthy);
  });
  if (!type) throw std::runtime_error(type.error().message);
  return *type;
}

/// Where the variance is what the model says.
const std::size_t factor_one = [] {
  for (std::size_t i = 0; i < factor_count; ++i)
    if (std::abs(log_factor(i)) < 1e-9) return i;
  throw std::logic_error("no factor of 1");
}();

struct Case {
  const char* name;
  PlantOptions plant;
  unsigned plants;        ///< in CI; the bars are for so many
  double false_maximum;   ///< share of false discoveries, mean over the plants, of `check`; nominal 4.75 %
  double watch_maximum;   ///< the same of `watch`
  double found, watched;  ///< share of the joints with 10 % wear that are found within 10 days, at least
};

/// Shares of tests and sums of squares over plants.
struct Tally {
  double share = 0, squares = 0, found = 0, worn = 0;
  void add(const std::vector<double>& p, const Plant& plant) {
    const auto q = adjusted(p, p.size());
    double listed = 0, wrong = 0;
    for (std::size_t i = 0; i < q.size(); ++i) {
      const bool bad = plant.joints[i].worn;
      worn += bad;
      if (q[i] <= rate) ++listed, wrong += !bad, found += bad;
    }
    const double one = listed > 0 ? wrong / listed : 0;
    share += one, squares += one * one;
  }
  double mean(double n) const { return share / n; }
  double sigma(double n) const { return std::sqrt((squares / n - mean(n) * mean(n)) / n); }
  static constexpr double rate = 0.05;
};

class Discoveries : public testing::TestWithParam<Case> {};

TEST_P(Discoveries, AreFalseAtTheNominalRateAndFindWear) {
  const unsigned first = number("TRIBOTWIN_FIRST_SEED", 1), n = number("TRIBOTWIN_PLANTS", GetParam().plants);
  Tally check, watch;
  constexpr std::array levels{0.1, 0.05, 0.01, 1e-3, 1e-4};
  std::array<double, levels.size()> below{};
  double healthy = 0;
  const CusumTail tail;
  for (unsigned seed = first; seed < first + n; ++seed) {
    const Plant plant(GetParam().plant, seed);
    const TypeModel type = learned(plant);
    const Judge judge(type);
    PersistenceWeights of_shifts(type, WeightsOf::shifts), of_charts(type, WeightsOf::charts);
    std::vector<Shift> shifts;
    std::vector<Chart> charts;
    for (const auto& j : plant.joints) {
      of_shifts.add(shifts.emplace_back(judge.shift(j.healthy, j.recent)).evidence);
      of_charts.add(charts.emplace_back(judge.watch(j.healthy, j.recent, tail, 1e-3)).evidence);
    }
    std::vector<double> p, p_watch;
    for (std::size_t i = 0; i < plant.joints.size(); ++i) {
      p.push_back(by_chance(shifts[i].by_chance, of_shifts.weights()));
      p_watch.push_back(by_chance(charts[i].steps.back().p, of_charts.weights()));
      if (plant.joints[i].worn) continue;
      ++healthy;
      for (std::size_t k = 0; k < levels.size(); ++k) below[k] += p.back() < levels[k];
    }
    check.add(p, plant), watch.add(p_watch, plant);
  }
  fmt::print(
      "{}: {} plants: false discoveries check {:.2f} +- {:.2f} %, watch {:.2f} +- {:.2f} %; worn found check "
      "{:.1f} %, watch {:.1f} %; healthy p below",
      GetParam().name, n, 100 * check.mean(n), 100 * check.sigma(n), 100 * watch.mean(n), 100 * watch.sigma(n),
      100 * check.found / check.worn, 100 * watch.found / watch.worn);
  for (std::size_t k = 0; k < levels.size(); ++k)
    fmt::print("{} {:g}: {:.3g} of it", k ? "," : "", levels[k], below[k] / healthy / levels[k]);
  fmt::print("\n");
  EXPECT_LE(check.mean(n), GetParam().false_maximum);
  EXPECT_LE(watch.mean(n), GetParam().watch_maximum);
  EXPECT_GE(check.found / check.worn, GetParam().found);
  EXPECT_GE(watch.found / watch.worn, GetParam().watched);
  // p is uniform on healthy joints, where most of them are and where lists begin. Binomial, and 4 sigma more.
  for (std::size_t k = 0; k + 1 < levels.size(); ++k) {
    const double expected = levels[k] * healthy, beyond = 4 * std::sqrt(expected);
    EXPECT_LE(below[k], 1.2 * expected + beyond) << levels[k];
    EXPECT_GE(below[k], 0.8 * expected - beyond) << levels[k];
  }
}

/// The mean of a robot with few curves is nearer to the truth with the others than without.
TEST(TypeModelOf, ARobotWithoutCurvesIsExpectedToBeLikeTheOthers) {
  const Plant plant({.robots = 60, .worn = 0}, 1);
  const TypeModel type = learned(plant);
  const Judge judge(type);
  int beyond = 0;
  for (const auto& j : plant.joints)
    beyond +=
        by_chance(judge.shift({}, j.recent).by_chance, PersistenceWeights(type, WeightsOf::shifts).weights()) < 0.05;
  EXPECT_LE(beyond, 9);  // of 60 at 5 %: 3, and 3 standard deviations
}

/// Two curves of each robot are its level and its effect of temperature: nothing is left that shows the scatter.
TEST(TypeModelOf, TwoCurvesOfEachRobotAreRefused) {
  const Plant plant({.robots = 60, .learned = 2, .fewest_learned = 2, .worn = 0}, 1);
  const auto type = learn_type([&](const auto& visit) {
    for (const auto& j : plant.joints) visit(j.healthy);
  });
  ASSERT_FALSE(type);
  EXPECT_THAT(type.error().message, testing::HasSubstr("beyond the first two of each robot"));
}

/// With the model by which a plant is made, nothing estimated, p of both regions is uniform.
void expect_uniform(const PlantOptions& options, unsigned seed) {
  constexpr std::array levels{0.5, 0.2, 0.1, 0.05, 0.01, 1e-3};
  const TypeModel type = true_model(options);
  const Judge judge(type);
  const Plant plant(options, seed);
  for (std::size_t r = 0; r < regions.size(); ++r) {
    std::array<double, levels.size()> below{};
    for (const auto& j : plant.joints) {
      const Shift shift = judge.shift(j.healthy, j.recent);
      for (std::size_t k = 0; k < levels.size(); ++k) below[k] += shift.by_chance[r][factor_one] < levels[k];
    }
    for (std::size_t k = 0; k < levels.size(); ++k) {
      const double n = static_cast<double>(options.robots), sigma = std::sqrt(levels[k] * (1 - levels[k]) / n);
      EXPECT_NEAR(below[k] / n, levels[k], 4 * sigma) << options.persistence << ' ' << r;
    }
  }
}
TEST(Shift, HasAUniformPUnderTheTrueModel) {
  for (const double persistence : {0.0, 0.8})
    expect_uniform({.robots = 15000, .learned = 6, .persistence = persistence, .worn = 0}, 72001);
}
/// Fits of one robot know Fc well and Vs badly, those of another the other way round.
TEST(Shift, HasAUniformPWhereFitsClaimDifferentFeatures) {
  expect_uniform({.robots = 15000, .learned = 6, .persistence = 0.5, .worn = 0, .claims = 0.4}, 72003);
}

/// Of most plants all joints are healthy: those of large shifts must not be taken for worn ones.
TEST(PersistenceWeights, FindNoFactorWhereTheModelIsTrue) {
  double mean = 0;
  constexpr unsigned plants = 40;
  const PlantOptions options{.scale_freedom = 1e6, .worn = 0};
  const TypeModel type = true_model(options);
  const Judge judge(type);
  for (unsigned seed = 73001; seed < 73001 + plants; ++seed) {
    PersistenceWeights weights(type, WeightsOf::shifts);
    for (const auto& j : Plant(options, seed).joints) weights.add(judge.shift(j.healthy, j.recent).evidence);
    const auto w = weights.weights();
    for (std::size_t i = 0; i < factor_count; ++i) mean += w[1][i] * log_factor(i) / plants;
  }
  EXPECT_NEAR(mean, 0, 0.025);  // of 8,000 joints with 2 numbers: sigma 0.011
}

TEST(PersistenceWeights, FindByWhichFactorShiftsScatterOtherwiseThanTheModelSays) {
  // Scatter that differs from robot to robot would be each robot's own.
  const PlantOptions options{.robots = 1000, .scale_freedom = 1e6, .worn = 0};
  TypeModel type = true_model(options);
  for (auto& m : type.region) m.decouple *= std::sqrt(1.3), m.mean *= std::sqrt(1.3), m.between *= 1.3;
  const Judge judge(type);
  PersistenceWeights weights(type, WeightsOf::shifts);
  for (const auto& j : Plant(options, 72002).joints) weights.add(judge.shift(j.healthy, j.recent).evidence);
  for (const auto& w : weights.weights()) {
    double mean = 0;
    for (std::size_t i = 0; i < factor_count; ++i) mean += w[i] * log_factor(i);
    EXPECT_NEAR(mean, std::log(1.3), 0.12);  // of 1,000 joints with 2 numbers: 4 times 0.03
  }
}

TEST(Adjusted, IsThatOfBenjamini1995) {
  // Table of section 4.1 of Benjamini 1995: at 5 % the first four of 15 are significant.
  constexpr std::array p{.0001, .0004, .0019, .0095, .0201, .0278, .0298, .0344,
                         .0459, .3240, .4262, .5719, .6528, .7590, 1.0};
  const auto q = adjusted(p, p.size());
  for (std::size_t i = 0; i < p.size(); ++i) EXPECT_EQ(q[i] <= .05, i < 4) << i;
  EXPECT_NEAR(q[0], .0015, 1e-12);
  EXPECT_NEAR(q[2], .0095, 1e-12);
}

TEST(CusumTail, IsThatOfSimulatedCharts) {
  const CusumTail tail;
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  constexpr int charts = 20000;
  for (const std::size_t steps : {1u, 5u, 40u}) {
    std::array<int, 3> above{};
    for (int i = 0; i < charts; ++i) {
      double c = 0;
      for (std::size_t n = 0; n < steps; ++n) c = std::max(0.0, c + normal(random) - 0.5);
      for (std::size_t k = 0; k < above.size(); ++k) above[k] += c >= 0.5 + static_cast<double>(k);
    }
    for (std::size_t k = 0; k < above.size(); ++k) {
      const double share = static_cast<double>(above[k]) / charts, p = tail(steps, 0.5 + static_cast<double>(k));
      // The chain rounds up.
      EXPECT_GE(p, share - 0.005) << steps << ' ' << k;
      EXPECT_LE(p, 1.15 * share + 0.005) << steps << ' ' << k;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Plants, Discoveries,
    testing::Values(
        Case{"usual", {}, 8, 0.10, 0.10, 0.98, 0.8}, Case{"small", {.robots = 40}, 10, 0.14, 0.14, 0.95, 0.5},
        Case{"few curves", {.learned = 6}, 4, 0.14, 0.14, 0.9, 0.2},
        Case{"small and few curves", {.robots = 40, .learned = 6}, 10, 0.14, 0.14, 0.8, 0.1},
        Case{"independent days", {.persistence = 0}, 8, 0.10, 0.12, 0.98, 0.98},
        Case{"long memory", {.persistence = 0.95}, 8, 0.12, 0.12, 0.95, 0.8},
        Case{
            "fitted", {.robots = 120, .learned = 14, .fewest_learned = 14, .fitted = true}, 8, 0.10, 0.12, 0.98, 0.95}),
    [](const auto& info) {
      std::string s = info.param.name;
      std::ranges::replace(s, ' ', '_');
      return s;
    });

}  // namespace
}  // namespace tribotwin::twin::diagnosis::fleet
