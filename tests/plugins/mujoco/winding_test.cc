#include <cmath>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/plugins/drive/keys.hpp>
#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>

namespace tribotwin::mujoco {
namespace {

using testing::HasSubstr;

const std::string winding = R"(<config key="winding_resistance_ohm" value="0.5"/>
      <config key="torque_constant_nm_A" value="0.1"/><config key="winding_heat_capacity_J_K" value="5"/>
      <config key="winding_thermal_resistance_K_W" value="0.4"/>)";

/// One joint with gravity and a motor that has a winding. 1 A is 5 Nm at the joint.
Result<std::shared_ptr<const Model>> arm(const std::string& keys, int actdim = 6,
                                         const std::string& integrator = "Euler") {
  return load_string(fmt::format(
      R"(<mujoco><option timestep="0.001" tolerance="1e-10" integrator="{}"/>
  <extension><plugin plugin="tribotwin.drive"><instance name="j"><config key="law" value="stribeck"/>
      <config key="Fc" value="0.03"/><config key="Fs" value="0.02"/><config key="Fv" value="4e-4"/>
      <config key="vs" value="10"/><config key="alpha" value="1.3"/><config key="torque_max_nm" value="100"/>
      <config key="gear_ratio" value="50"/><config key="thermal" value="second_order"/><config key="c1" value="1e-2"/>
      <config key="c2" value="1e-3"/><config key="t1" value="20"/><config key="t2" value="300"/>{}</instance>
      </plugin></extension>
  <worldbody><body><joint name="hinge" axis="0 1 0" armature="2" frictionloss="1" solreffriction=".001 1"
      solimpfriction=".9999 .9999 .001 .5 2"/><geom type="sphere" size=".1" pos=".5 0 0" mass="4"/></body></worldbody>
  <actuator><plugin name="drive" joint="hinge" plugin="tribotwin.drive" instance="j" actdim="{}" dyntype="user"/>
  </actuator></mujoco>)",
      integrator, keys, actdim));
}

const drive::MotorState& motor(const mjData* d, const Binding& b) {
  return static_cast<const drive::MotorState&>(state(d, b));
}

TEST(Winding, FrictionAndCopperHeatThreeNodesAndTheirHeatBalances) {
  const auto model = arm(winding);
  ASSERT_TRUE(model) << model.error().message;
  const Binding& b = (*model)->drives()[0];
  const DataPtr d = (*model)->make_data();
  double lost_J = 0, power_W = 0;
  for (int i = 0; i < 20'000; ++i) {
    d->ctrl[0] = 50 * std::sin(i * 2e-3);
    const drive::Workspace before = workspace(d.get(), b);
    const thermal::Rise rise = state(d.get(), b).rise;
    (*model)->step(d.get());
    const drive::Workspace& s = workspace(d.get(), b);
    EXPECT_DOUBLE_EQ(s.current_A, s.torque_nm / 5);
    power_W = (s.heat_J - before.heat_J) / 1e-3;
    lost_J += power_W * 1e-3 - (state(d.get(), b).rise.node_K[0] - rise.node_K[0]) / b.drive.thermal.gain_K_J[0];
  }
  const drive::Workspace& s = workspace(d.get(), b);
  EXPECT_GT(s.winding_heat_J, 1);
  EXPECT_GT(s.friction_work_J, 1);
  EXPECT_NEAR(s.heat_J, s.friction_work_J + s.winding_heat_J, 1e-9 * s.heat_J);
  EXPECT_NEAR(s.copper_loss_J, s.winding_heat_J + 5 * motor(d.get(), b).winding.rise_K, 1e-9 * s.copper_loss_J);
  EXPECT_NEAR(s.heat_J, lost_J + state(d.get(), b).rise.node_K[0] / b.drive.thermal.gain_K_J[0], 1e-9 * s.heat_J);
  EXPECT_GT(motor(d.get(), b).winding.rise_K, state(d.get(), b).rise.total_K());
}

TEST(Winding, AWarmMotorGivesLessThanItsCurrentTells) {
  for (const char* integrator : {"Euler", "RK4"}) {
    const auto warm = arm(winding + R"(<config key="winding_copper_1_K" value="0"/>)", 6, integrator),
               cold = arm("", 3, integrator);
    ASSERT_TRUE(warm && cold);
    const Binding &a = (*warm)->drives()[0], &b = (*cold)->drives()[0];
    const DataPtr hot = (*warm)->make_data(), plain = (*cold)->make_data();
    drive::set_winding(a.drive, state(hot.get(), a), 105);  // 8 % less at first
    EXPECT_NEAR(drive::winding_degC(a.drive, state(hot.get(), a)), 105, 1e-12);
    for (int i = 0; i < 2000; ++i) {
      hot->ctrl[0] = 40 * std::sin(i * 3e-3);
      plain->ctrl[0] = (1 - 0.001 * (drive::winding_degC(a.drive, state(hot.get(), a)) - 25)) * hot->ctrl[0];
      // The gear of a drive with a winding is warmer; this law does not depend on it.
      (*warm)->step(hot.get());
      (*cold)->step(plain.get());
    }
    EXPECT_GT(std::abs(plain->qpos[0]), 0.01);
    EXPECT_NEAR(hot->qpos[0], plain->qpos[0], 1e-9) << integrator;
    EXPECT_DOUBLE_EQ(workspace(hot.get(), a).torque_nm, hot->ctrl[0]);
    EXPECT_NEAR(drive::delivered_nm(workspace(hot.get(), a)), plain->ctrl[0], 1e-12);
  }
}

TEST(Winding, TheDriveLimitsItsCurrent) {
  const auto limited = arm(winding + R"(<config key="current_max_A" value="8"/>)"), plain = arm("", 3);
  ASSERT_TRUE(limited) << limited.error().message;
  const Binding &a = (*limited)->drives()[0], &b = (*plain)->drives()[0];
  const DataPtr d = (*limited)->make_data(), e = (*plain)->make_data();
  for (int i = 0; i < 500; ++i) {
    d->ctrl[0] = -90;
    e->ctrl[0] = -40 * (1 - workspace(d.get(), a).hot_torque_loss * (i > 0));
    (*limited)->step(d.get());
    (*plain)->step(e.get());
    ASSERT_DOUBLE_EQ(workspace(d.get(), a).torque_nm, -40);
  }
  EXPECT_NEAR(d->qpos[0], e->qpos[0], 1e-4 * std::abs(e->qpos[0]));
  EXPECT_NEAR(state(d.get(), a).load_nm, state(e.get(), b).load_nm, 1e-2);
}

TEST(Winding, AHotDriveSettlesBelowItsLimitTemperature) {
  const auto model = arm(winding + R"(<config key="winding_warning_degC" value="60"/>
      <config key="winding_limit_degC" value="80"/><config key="brake_torque_nm" value="500"/>)");
  ASSERT_TRUE(model) << model.error().message;
  const Binding& b = (*model)->drives()[0];
  const DataPtr d = (*model)->make_data();
  workspace(d.get(), b).brake_engaged = 1;
  double most_degC = 0;
  for (int i = 0; i < 60'000; ++i) {
    d->ctrl[0] = 100;
    (*model)->step(d.get());
    most_degC = std::max(most_degC, drive::winding_degC(b.drive, state(d.get(), b)));
  }
  EXPECT_GT(most_degC, 60);
  EXPECT_LT(most_degC, 80);
  EXPECT_LT(workspace(d.get(), b).current_A, 20);
  EXPECT_DOUBLE_EQ(workspace(d.get(), b).current_A, workspace(d.get(), b).current_limit_A);
}

TEST(Winding, RefusesWhatIsNoMotor) {
  const auto error = [](const std::string& keys, int actdim = 6) {
    const auto model = arm(keys, actdim);
    return model ? "loaded" : model.error().message;
  };
  EXPECT_EQ(error(winding), "loaded");
  EXPECT_THAT(error(winding, 3), HasSubstr("actdim=\"6\""));
  EXPECT_THAT(error(R"(<config key="current_max_A" value="1"/>)", 3), HasSubstr("give 'winding_resistance_ohm'"));
  EXPECT_THAT(error(R"(<config key="winding_resistance_ohm" value="1"/>)"), HasSubstr("'torque_constant_nm_A'"));
  EXPECT_THAT(error(winding + R"(<config key="winding_limit_degC" value="100"/>)"), HasSubstr("winding_warning_degC"));
  EXPECT_THAT(error(winding + R"(<config key="current_rated_A" value="1"/>)"), HasSubstr("overload_s"));
  EXPECT_THAT(error(winding + R"(<config key="current_rated_A" value="30"/><config key="overload_s" value="1"/>)"),
              HasSubstr("below current_max_A 20"));
  EXPECT_THAT(error(winding + R"(<config key="winding_mass_kg" value="1"/>)"), HasSubstr("did you mean 'winding_"));
}

TEST(Winding, ItsKeysReadBack) {
  const auto model = arm(winding + R"(<config key="current_rated_A" value="3"/><config key="overload_s" value="7"/>
      <config key="winding_copper_1_K" value="0"/>)");
  ASSERT_TRUE(model) << model.error().message;
  const drive::Drive& one = (*model)->drives()[0].drive;
  const auto again = drive::make_drive("j", drive::configuration_of(one));
  ASSERT_TRUE(again) << again.error().message;
  thermal::Winding a = one.winding, b = again->winding;
  for (std::size_t i = 0; i < drive::winding_key_count; ++i)
    EXPECT_EQ(*drive::winding_values(a)[i], *drive::winding_values(b)[i]) << drive::winding_keys()[i].name;
}

}  // namespace
}  // namespace tribotwin::mujoco
