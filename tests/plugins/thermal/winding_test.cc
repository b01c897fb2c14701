#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include <tribotwin/plugins/thermal/thermal.hpp>
#include <tribotwin/plugins/thermal/winding.hpp>

namespace tribotwin::thermal {
namespace {

Winding motor() {
  return {.resistance_ohm = 0.8,
          .torque_constant_nm_A = 0.12,
          .heat_capacity_J_K = 60,
          .thermal_resistance_K_W = 1.5,
          .copper_1_K = 0.00393,
          .magnet_1_K = 0.001,
          .warning_degC = 130,
          .limit_degC = 155,
          .current_max_A = 10,
          .current_rated_A = 4,
          .overload_s = 20};
}

TEST(Winding, WarmCopperResistsMoreAndWarmMagnetsPullLess) {
  const Winding w = motor();
  EXPECT_DOUBLE_EQ(w.resistance_at_ohm(125), 0.8 * 1.393);
  EXPECT_DOUBLE_EQ(w.torque_share(125), 0.9);
}

TEST(Winding, ConstantLossBesideAGearThatRestsFollowsTheClosedFormForAnyTimeStep) {
  Winding w = motor();
  w.copper_1_K = 0;
  for (const double dt : {1e-3, 0.1, 5.0, 50.0}) {
    WindingState state;
    const int steps = static_cast<int>(100 / dt);
    for (int i = 0; i < steps; ++i) step(w, 25 + state.rise_K, 5, 7, dt, state);
    const double end_K = 7 + 1.5 * 25 * 0.8;
    EXPECT_NEAR(state.rise_K, end_K * -std::expm1(-steps * dt / 90), 1e-9 * end_K) << dt;
  }
}

TEST(Winding, HeatOfThreeNodesBalances) {
  const Winding w = motor();
  const Model gear = make_model(Order::second, 25, std::vector{1e-3, 2e-4, 150.0, 2000.0});
  const double dt = 1e-2;
  const Decay d = decay(gear, dt);
  WindingState state;
  Rise rise;
  double copper_J = 0, flowed_J = 0, lost_J[2] = {0, 0};
  for (int i = 0; i < 200'000; ++i) {
    const double current_A = 4 * std::sin(i * dt / 7);
    const WindingHeat heat = step(w, 25 + state.rise_K, current_A, rise.total_K(), dt, state);
    copper_J += heat.copper_W * dt;
    flowed_J += heat.to_gear_W * dt;
    const Rise before = rise;
    step(gear, d, heat.to_gear_W, 0, rise);
    // A node stores x / g; the rest of what it received has left it.
    for (const int n : {0, 1})
      lost_J[n] += heat.to_gear_W * dt - (rise.node_K[n] - before.node_K[n]) / gear.gain_K_J[n];
  }
  EXPECT_GT(state.rise_K, rise.total_K());
  EXPECT_NEAR(copper_J, flowed_J + 60 * state.rise_K, 1e-9 * copper_J);
  for (const int n : {0, 1}) EXPECT_NEAR(flowed_J, lost_J[n] + rise.node_K[n] / gear.gain_K_J[n], 1e-9 * flowed_J);
  EXPECT_GT(rise.total_K(), 1);
}

TEST(Winding, TheCurrentLimitFallsBetweenWarningAndLimit) {
  const Winding w = motor();
  EXPECT_EQ(w.current_limit_A(130, 0), 10);
  EXPECT_DOUBLE_EQ(w.current_limit_A(142.5, 0), 5);
  EXPECT_EQ(w.current_limit_A(155, 0), 0);
  EXPECT_EQ(w.current_limit_A(300, 0), 0);
  EXPECT_DOUBLE_EQ(w.current_limit_A(25, 1), 4);
}

TEST(Winding, TheLargestCurrentMayFlowForTheOverloadTimeAndTheRatedOneForEver) {
  Winding w = motor();
  w.heat_capacity_J_K = 1e6;  // it stays cold
  WindingState state;
  const double dt = 1e-3;
  double full_s = 0;
  for (; state.overload < 0.8 - 1e-9; full_s += dt) step(w, 25, 10, 0, dt, state);
  EXPECT_NEAR(full_s, 0.8 * 20, 2 * dt);  // then the limit begins to fall
  double current_A = 10;
  for (double t = 0; t < 1000; t += dt) step(w, 25, current_A = w.current_limit_A(25, state.overload), 0, dt, state);
  EXPECT_NEAR(current_A, 4, 1e-6);
  for (double t = 0; t < 1000; t += 1) step(w, 25, 4, 0, 1, state);
  EXPECT_NEAR(w.current_limit_A(25, state.overload), 4, 1e-6);
  step(w, 25, 0, 0, 1000, state);
  EXPECT_EQ(w.current_limit_A(25, state.overload), 10);
}

}  // namespace
}  // namespace tribotwin::thermal
