// False discoveries and power over synthetic plants. TRIBOTWIN_PLANTS=100 for the figures of the README.
#include <cstdlib>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/tests/twin/diagnosis/fleet/plant.hpp>
#include <tribotwin/twin/diagnosis/fleet/judge.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

unsigned plants() {
  const char* given = std::getenv("TRIBOTWIN_PLANTS");
  return given ? static_cast<unsigned>(std::atoi(given)) : 4;
}

TypeModel learned(const Plant& plant) {
  const auto type = learn_type([&](const auto& visit) {
    for (const auto& j : plant.joints) visit(j.healthy);
  });
  if (!type) throw std::runtime_error(type.error().message);
  return *type;
}

struct Case {
  const char* name;
  PlantOptions plant;
  double power;  ///< share of the joints with 10 % wear that are found within 10 days, at least
};

class Discoveries : public testing::TestWithParam<Case> {};

TEST_P(Discoveries, AreFalseAtTheNominalRateAndFindWear) {
  constexpr double rate = 0.05;
  double share = 0, watched_share = 0, found = 0, watched = 0, worn = 0, p_1 = 0, p_5 = 0, healthy = 0;
  const CusumTail tail;
  for (unsigned seed = 1; seed <= plants(); ++seed) {
    const Plant plant(GetParam().plant, seed);
    const TypeModel type = learned(plant);
    std::vector<double> p, charts;
    for (const auto& j : plant.joints) {
      p.push_back(judge_window(type, j.healthy, j.recent).p);
      charts.push_back(watch_joint(type, j.healthy, j.recent, tail, 1e-3).steps.back().p);
      if (!j.worn) p_1 += p.back() < .01, p_5 += p.back() < .05, ++healthy;
    }
    const auto q = adjusted(p, p.size()), q_watch = adjusted(charts, charts.size());
    double listed = 0, wrong = 0, listed_watch = 0, wrong_watch = 0;
    for (std::size_t i = 0; i < q.size(); ++i) {
      const bool bad = plant.joints[i].worn;
      worn += bad;
      if (q[i] <= rate) ++listed, wrong += !bad, found += bad;
      if (q_watch[i] <= rate) ++listed_watch, wrong_watch += !bad, watched += bad;
    }
    share += listed > 0 ? wrong / listed : 0;
    watched_share += listed_watch > 0 ? wrong_watch / listed_watch : 0;
  }
  const double n = plants();
  fmt::print(
      "{}: false discoveries check {:.2f} %, watch {:.2f} %; worn found check {:.1f} %, watch {:.1f} %; healthy "
      "p < 1 %: {:.2f} %, p < 5 %: {:.2f} %\n",
      GetParam().name, 100 * share / n, 100 * watched_share / n, 100 * found / worn, 100 * watched / worn,
      100 * p_1 / healthy, 100 * p_5 / healthy);
}

/// The mean of a robot with few curves is nearer to the truth with the others than without.
TEST(TypeModelOf, ARobotWithoutCurvesIsExpectedToBeLikeTheOthers) {
  const Plant plant({.robots = 60, .worn = 0}, 1);
  const TypeModel type = learned(plant);
  int beyond = 0;
  for (const auto& j : plant.joints) beyond += judge_window(type, {}, j.recent).p < 0.05;
  EXPECT_LE(beyond, 9);  // of 60 at 5 %: 3, and 3 standard deviations
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

INSTANTIATE_TEST_SUITE_P(Plants, Discoveries,
                         testing::Values(Case{"usual", {}, 0.95}, Case{"small", {.robots = 40}, 0.7},
                                         Case{"few curves", {.learned = 6}, 0.1},
                                         Case{"independent days", {.persistence = 0}, 0.95},
                                         Case{"long memory", {.persistence = 0.95}, 0.6}),
                         [](const auto& info) {
                           std::string s = info.param.name;
                           std::ranges::replace(s, ' ', '_');
                           return s;
                         });

}  // namespace
}  // namespace tribotwin::twin::diagnosis::fleet
