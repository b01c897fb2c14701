#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include <tribotwin/plugins/drive/slide.hpp>

namespace tribotwin::drive {
namespace {

Drive heated() {
  Drive d{
      .name = "joint", .law = friction::published_law("extended").value(), .torque_max_nm = 7500, .gear_ratio = 178};
  d.thermal = thermal::make_model(thermal::Order::first, 40, std::vector{0.1, 600.0});
  return d;
}

TEST(Slide, HasTheFrictionOfTheLaw) {
  const Drive d = heated();
  Sliding s;
  set_temperature(d, s.state, 55);
  const auto decay = thermal::decay(d.thermal, 1e-3);
  for (const double speed : {0.01, 0.3, -1.2})
    for (const double load : {0.0, 3000.0, -3000.0}) {
      const double expected = 7500 * friction::torque(d.law, 178 * speed, load / 7500, 55);
      EXPECT_NEAR(slide(d, decay, speed, load, s), expected, 1e-5 * std::abs(expected)) << speed << ' ' << load;
      EXPECT_EQ(s.state.load_nm, load);
    }
}

TEST(Slide, HeatsByItsFriction) {
  Drive d = heated();
  d.law =
      friction::make_law("stribeck", {{{"Fc", 0.04}, {"Fs", 0.0}, {"Fv", 0.0}, {"vs", 1.0}, {"alpha", 1.0}}}).value();
  Sliding s;
  const auto decay = thermal::decay(d.thermal, 0.5);
  for (int k = 0; k < 1200; ++k) slide(d, decay, 2, 0, s);  // ten minutes of 300 Nm at 2 rad/s
  EXPECT_NEAR(s.workspace.heat_J, 600 * 600, 1e-6);
  EXPECT_NEAR(temperature_degC(d, s.state), 40 + 0.1 * 600 * (1 - std::exp(-1)), 1e-9);
  EXPECT_NEAR(s.position_rad, 1200, 1e-9);
}

TEST(Slide, AtRestTheLimitHolds) {
  const Drive d = heated();
  Sliding s;
  EXPECT_EQ(slide(d, thermal::decay(d.thermal, 1), 0, 0, s), 0);
  const auto at = friction::at_temperature(d.law, 40);
  EXPECT_DOUBLE_EQ(s.workspace.limit_nm, 7500 * friction::level(d.law, at, 0, 0).total());
}

TEST(Slide, WhatIsNoNumberCountsAsNothing) {
  const Drive d = heated();
  Sliding s;
  const auto decay = thermal::decay(d.thermal, 1);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(slide(d, decay, nan, 0, s), 0);
  EXPECT_EQ(s.workspace.outside, 1);
  EXPECT_TRUE(std::isfinite(slide(d, decay, 1, nan, s)));
  EXPECT_TRUE(std::isfinite(slide(d, decay, 1e300, 0, s)));
  const double before = temperature_degC(d, s.state);
  for (const double dt : {0.0, -1.0, nan, 1e300}) EXPECT_GT(slide(d, thermal::decay(d.thermal, dt), 1, 0, s), 0) << dt;
  EXPECT_EQ(temperature_degC(d, s.state), before);
}

/// At rest, beside a gear that stays at 40 degC. 1 A is 20 Nm at the joint.
Drive with_winding() {
  Drive d = heated();
  d.thermal = thermal::make_model(thermal::Order::prescribed, 40, {});
  d.gear_ratio = 100;
  d.winding = {.resistance_ohm = 0.8,
               .torque_constant_nm_A = 0.2,
               .heat_capacity_J_K = 4,
               .thermal_resistance_K_W = 0.5,
               .warning_degC = 90,
               .limit_degC = 120,
               .current_max_A = 30};
  return d;
}

TEST(Slide, AWindingWarmsByTheCurrentOfLoadAndOffset) {
  Drive d = with_winding();
  d.offset_nm = 40;
  for (const double dt : {1e-3, 0.1, 3.0}) {
    Sliding s;
    set_winding(d, s.state, 40);
    const int steps = static_cast<int>(3 / dt);
    for (int k = 0; k < steps; ++k) slide(d, thermal::decay(d.thermal, dt), 0, 160, s);
    EXPECT_DOUBLE_EQ(s.workspace.current_A, 10);
    const double loss_W = 10 * 10 * 0.8, end_K = loss_W * 0.5 * -std::expm1(-steps * dt / (0.5 * 4));
    EXPECT_NEAR(winding_degC(d, s.state), 40 + end_K, 1e-9) << dt;
    EXPECT_NEAR(s.workspace.copper_loss_J, loss_W * steps * dt, 1e-8) << dt;
    EXPECT_NEAR(s.workspace.winding_heat_J, loss_W * steps * dt - 4 * end_K, 1e-8) << dt;
    EXPECT_EQ(s.workspace.heat_J, s.workspace.winding_heat_J);  // at rest there is no other
  }
}

TEST(Slide, AWindingTakesNoMoreCurrentThanTheDriveGives) {
  Drive d = with_winding();
  d.winding.copper_1_K = 0.004;
  // Where copper loss at the limit equals what flows to the gear.
  double low_degC = 90, high_degC = 120;
  for (int i = 0; i < 100; ++i) {
    const double T = (low_degC + high_degC) / 2, I = 30 * (120 - T) / 30;
    (I * I * 0.8 * (1 + 0.004 * (T - 25)) * 0.5 > T - 40 ? low_degC : high_degC) = T;
  }
  Sliding s;
  set_winding(d, s.state, 40);
  slide(d, thermal::decay(d.thermal, 1e-3), 0, 5000, s);
  EXPECT_EQ(s.workspace.current_A, 30);
  for (int k = 0; k < 60'000; ++k) slide(d, thermal::decay(d.thermal, 1e-3), 0, 5000, s);
  EXPECT_NEAR(winding_degC(d, s.state), low_degC, 1e-9);
  EXPECT_EQ(s.workspace.current_A, s.workspace.current_limit_A);
}

TEST(Slide, AMotorWithALowTorqueConstantTakesMoreCurrent) {
  const Drive d = with_winding();
  Sliding s;
  set_faults(s.workspace, {.torque_loss = 0.2});
  slide(d, thermal::decay(d.thermal, 1e-3), 0, 160, s);
  EXPECT_DOUBLE_EQ(s.workspace.current_A, 10);
}

}  // namespace
}  // namespace tribotwin::drive
