#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <tribotwin/plugins/thermal/thermal.hpp>

namespace tribotwin::thermal {
namespace {

TEST(Thermal, StepResponseEqualsTheClosedFormForAnyTimeStep) {
  // Pagani (4); Bittencourt 2012 with kappa = 3.04 h and Hao 2021's joint 1, minutes to seconds.
  struct Case {
    Model model;
    std::vector<std::pair<double, double>> poles;
  };  // gain x time constant, time constant
  const double t1 = 2.4465 * 60, t2 = 35.4424 * 60;
  const Case cases[] = {
      {make_model(Order::first, 25, std::vector{0.15, 10944.0}), {{0.15, 10944}}},
      {make_model(Order::second, 20, std::vector{1e-4, 2e-5, t1, t2}), {{1e-4 * t1, t1}, {2e-5 * t2, t2}}},
  };
  for (const auto& [model, poles] : cases)
    for (const double dt : {1e-4, 1e-3, 0.02, 1.0, 10.0}) {
      const Decay d = decay(model, dt);
      Rise rise;
      const int steps = std::min(2'000'000, static_cast<int>(20000 / dt));
      for (int i = 0; i < steps; ++i) step(model, d, 380, 0, rise);
      double expected = 0;
      for (const auto& [resistance, t] : poles) expected += 380 * resistance * -std::expm1(-steps * dt / t);
      EXPECT_NEAR(rise.total_K(), expected, 1e-9 * expected) << dt;
    }
}

TEST(Thermal, AmbientChangeArrivesThroughTheNodesAndWhole) {
  const Model model = make_model(Order::second, 20, std::vector{1e-4, 2e-5, 100.0, 2000.0});
  Rise rise;
  step(model, decay(model, 1e-3), 0, 10, rise);
  EXPECT_LT(rise.total_K(), 1e-3);
  step(model, decay(model, 1e7), 0, 10, rise);
  EXPECT_NEAR(rise.total_K(), 10, 1e-12);
}

TEST(Thermal, PrescribedTemperatureRests) {
  const Model model = make_model(Order::prescribed, 20, {});
  Rise rise = steady_rise(model, 30);
  step(model, decay(model, 10), 1e6, 5, rise);
  EXPECT_EQ(rise.total_K(), 30);
}

TEST(Thermal, SteadyRiseStays) {
  const Model model = make_model(Order::second, 20, std::vector{1e-4, 2e-5, 100.0, 2000.0});
  Rise rise = steady_rise(model, 500 * model.resistance_K_W());
  const Rise before = rise;
  step(model, decay(model, 33), 500, 0, rise);
  for (int i : {0, 1}) EXPECT_NEAR(rise.node_K[i], before.node_K[i], 1e-12);
}

/// By steps of 0.01 s.
double time_by_steps_s(const Model& model, Rise rise, double power_W, double total_K) {
  const Decay d = decay(model, 0.01);
  for (int k = 0; k < 2'000'000; ++k) {
    if (rise.total_K() >= total_K) return 0.01 * k;
    step(model, d, power_W, 0, rise);
  }
  return std::numeric_limits<double>::infinity();
}

TEST(Thermal, TimeToReachARiseIsThatOfTheSteps) {
  const Model first = make_model(Order::first, 25, std::vector{0.15, 1094.0});
  const Model second = make_model(Order::second, 20, std::vector{1e-3, 2e-5, 100.0, 2000.0});
  const struct {
    Model model;
    Rise rise;
    double power_W, total_K;
  } cases[] = {
      {first, {{5, 0}}, 300, 30},      // rises
      {first, {{5, 0}}, 300, 46},      // ends below
      {first, {{5, 0}}, 300, 4},       // is there
      {second, {{0, 0}}, 300, 35},     // rises
      {second, {{0, 9}}, 100, 15},     // rises by the fast node, then falls below where it was
      {second, {{0, 20}}, 100, 25},    // the same, and never comes so far
      {second, {{20, 0}}, 110, 14},    // is there
      {second, {{12, 0}}, 100, 12.5},  // falls by the fast node, then rises
      {make_model(Order::prescribed, 20, {}), {{10, 0}}, 1000, 20},
  };
  for (const auto& [model, rise, power_W, total_K] : cases) {
    const double expected = time_by_steps_s(model, rise, power_W, total_K);
    const double found = time_to_reach_s(model, rise, power_W, 0, total_K);
    if (std::isinf(expected))
      EXPECT_EQ(found, expected) << total_K;
    else
      EXPECT_NEAR(found, expected, 0.01) << total_K;
  }
}

TEST(Thermal, TheTopOfARiseThatTurnsIsReached) {
  const Model model = make_model(Order::second, 20, std::vector{1e-3, 2e-5, 100.0, 2000.0});
  const Decay d = decay(model, 0.01);
  const Rise before{{0, 9}};
  Rise rise = before;
  double top_K = 0;
  for (int k = 0; k < 100'000; ++k) step(model, d, 100, 0, rise), top_K = std::max(top_K, rise.total_K());
  EXPECT_NEAR(time_to_reach_s(model, before, 100, 0, top_K - 1e-9), time_by_steps_s(model, before, 100, top_K - 1e-9),
              0.01);
}

TEST(Thermal, ValuesAreThoseOfWhichAModelIsMade) {
  for (const std::vector<double>& given : {std::vector{0.15, 10944.0}, {1e-4, 2e-5, 146.8, 2126.5}}) {
    const Model model = make_model(given.size() == 2 ? Order::first : Order::second, 25, given);
    const auto made = values(model);
    ASSERT_EQ(made.size(), given.size());
    for (std::size_t i = 0; i < given.size(); ++i) EXPECT_DOUBLE_EQ(made[i], given[i]) << i;
  }
  EXPECT_TRUE(values(make_model(Order::prescribed, 25, {})).empty());
  EXPECT_EQ(model_names(), "prescribed, first_order or second_order");
}

TEST(Thermal, FastestAndSlowestAreOfTheNodesInUse) {
  const Model first = make_model(Order::first, 25, std::vector{0.15, 100.0});
  EXPECT_EQ(first.fastest_s(), 100);
  EXPECT_EQ(first.slowest_s(), 100);
  for (const auto& [one_s, other_s] : {std::pair(100.0, 2000.0), {2000.0, 100.0}}) {
    const Model second = make_model(Order::second, 25, std::vector{1e-4, 2e-5, one_s, other_s});
    EXPECT_EQ(second.fastest_s(), 100);
    EXPECT_EQ(second.slowest_s(), 2000);
  }
}

}  // namespace
}  // namespace tribotwin::thermal
