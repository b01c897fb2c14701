#include <cmath>

#include <gtest/gtest.h>

#include <tribotwin/twin/identification/rigid_body/temperature_estimator.hpp>
#include <tribotwin/twin/identification/thermal/thermal_torque.hpp>

namespace tribotwin::twin::identification {
namespace {

/// The ER3A's third joint.
const thermal::Model joint3 =
    thermal::make_model(thermal::Order::second, 20, std::vector{0.07548, 0.00681, 55.032, 1423.12});
const std::vector<double> f{3.85, 1.103, -0.07079, 0.004636, -0.0128, 20};

TemperatureEstimator estimator(double a, double start_degC = 20) {
  auto p = f;
  p[4] = a;
  return {JointFriction(*friction::find_law("polynomial"), {}), p, joint3, start_degC};
}

double rise_K(double power_w, double t_s) {  // Pagani (4)
  double rise = 0;
  for (int i : {0, 1}) rise += joint3.gain_K_J[i] * joint3.t_s[i] * -std::expm1(-t_s / joint3.t_s[i]) * power_w;
  return rise;
}

TEST(TemperatureEstimator, ConstantHeatIsTheClosedFormForAnyTimeStep) {
  for (const double dt : {0.01, 1.0, 600.0}) {
    TemperatureEstimator joint = estimator(0);
    const double v = 1.5, power = joint.friction(v, 0) * v;
    for (int k = 0; k < std::lround(1800 / dt); ++k) joint.update(v, 0, dt);
    EXPECT_NEAR(joint.temperature_degC(), 20 + rise_K(power, 1800), 1e-8) << dt;
  }
}

TEST(TemperatureEstimator, FrictionFallsAsTheClosedFormOfARepeatedCycle) {
  // There and back at 1.5 rad/s and a rest, 2 s.
  TemperatureEstimator joint = estimator(-0.0128);
  const double dt = 0.02, cold = joint.friction(1.5, 0), rest_power = cold * 1.5 * 0.8;
  double t = 0, worst = 0;
  for (int cycle = 0; cycle < 5400; ++cycle)
    for (int k = 0; k < 100; ++k, t += dt) {
      if (k == 50)
        worst = std::max(worst,
                         std::abs(joint.friction(1.5, 0) / cold / friction_share(joint3, -0.0128, rest_power, t) - 1));
      joint.update(k < 40 ? 1.5 : k < 80 ? -1.5 : 0, 0, dt);
    }
  EXPECT_LT(worst, 2e-3);
  const double end = friction_share(joint3, -0.0128, rest_power, 1e6);
  EXPECT_NEAR(end, 1 / (1 + 0.0128 * rest_power * joint3.resistance_K_W()), 1e-12);
  EXPECT_NEAR(joint.friction(1.5, 0) / cold, end, 3e-3);
}

TEST(FrictionShare, IsPaper5WhereTheHeatStays) {
  // (6): a change so small that friction, and with it the heat, stays.
  for (const double t : {1.0, 60.0, 900.0, 1e4})
    EXPECT_NEAR((friction_share(joint3, -1e-7, 5, t) - 1) / -1e-7, rise_K(5, t), 1e-4 * rise_K(5, t)) << t;
}

TEST(FrictionShare, FirstOrderAndEqualNodesAreLimits) {
  const auto one = thermal::make_model(thermal::Order::first, 20, std::vector{8.0, 900.0});
  const auto two = thermal::make_model(thermal::Order::second, 20, std::vector{4.0 / 900, 4.0 / 900, 900.0, 900.0});
  for (const double t : {0.0, 1.0, 500.0, 5000.0})
    EXPECT_NEAR(friction_share(two, -0.0128, 5, t), friction_share(one, -0.0128, 5, t), 1e-12) << t;
  EXPECT_EQ(friction_share(one, -0.0128, 5, 0), 1);
}

TEST(TemperatureEstimator, AWarmStartCoolsAtRest) {
  TemperatureEstimator joint = estimator(-0.0128, 50);
  EXPECT_NEAR(joint.friction(1, 0), estimator(0).friction(1, 0) * (1 - 0.0128 * 30), 1e-12);
  joint.update(0, 10, 3 * 1423.12);
  EXPECT_GT(joint.temperature_degC(), 20);
  EXPECT_LT(joint.temperature_degC(), 22);
}

}  // namespace
}  // namespace tribotwin::twin::identification
