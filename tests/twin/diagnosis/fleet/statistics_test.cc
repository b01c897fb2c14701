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
  return given ? static_cast<unsigned>(std::atoi(given)) : 6;
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
};

class Discoveries : public testing::TestWithParam<Case> {};

TEST_P(Discoveries, AreFalseAtTheNominalRateAndFindWear) {
  constexpr double rate = 0.05;
  double share = 0, watched_share = 0, found = 0, watched = 0, worn = 0, p_1 = 0, p_5 = 0, healthy = 0;
  const CusumTail tail;
  for (unsigned seed = 1; seed <= plants(); ++seed) {
    const Plant plant(GetParam().plant, seed);
    const TypeModel type = learned(plant);
    if (seed == 1)
      for (const auto& m : type.region)
        fmt::print("phi {} k {:.1f} lambda {:.2f} between {:.2f}\n", m.persistence, m.scale_freedom,
                   m.lambda.maxCoeff(), m.between.diagonal().maxCoeff());
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

INSTANTIATE_TEST_SUITE_P(Plants, Discoveries,
                         testing::Values(Case{"usual", {}}, Case{"small", {.robots = 40}},
                                         Case{"few curves", {.learned = 6}},
                                         Case{"independent days", {.persistence = 0}},
                                         Case{"long memory", {.persistence = 0.95}}),
                         [](const auto& info) {
                           std::string s = info.param.name;
                           std::ranges::replace(s, ' ', '_');
                           return s;
                         });

}  // namespace
}  // namespace tribotwin::twin::diagnosis::fleet
