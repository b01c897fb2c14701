#include <gtest/gtest.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/control/servo.hpp>

namespace tribotwin::twin {
namespace {

/// Two joints; nothing moves here. `winding`: keys of the second drive.
std::shared_ptr<const mujoco::Model> two_joints(const std::string& winding = "") {
  std::string text = R"(<mujoco><option timestep="0.001"/>
  <extension><plugin plugin="tribotwin.drive">
    <instance name="a"><config key="law" value="stribeck"/><config key="Fc" value="0.01"/><config key="Fs" value="0"/>
      <config key="vs" value="10"/><config key="alpha" value="1"/><config key="Fv" value="0"/>
      <config key="torque_max_nm" value="10"/><config key="gear_ratio" value="50"/></instance>
    <instance name="b"><config key="law" value="stribeck"/><config key="Fc" value="0.01"/><config key="Fs" value="0"/>
      <config key="vs" value="10"/><config key="alpha" value="1"/><config key="Fv" value="0"/>
      <config key="torque_max_nm" value="10"/><config key="gear_ratio" value="50"/>WINDING</instance>
  </plugin></extension>
  <default><joint frictionloss="0.1" solreffriction=".001 1" solimpfriction=".9999 .9999 .001 .5 2"/></default>
  <worldbody>
    <body><joint name="first" axis="0 1 0" armature="0.1"/><geom size=".05" pos="0 0 -.2" mass="1"/></body>
    <body pos="1 0 0"><joint name="second" axis="0 1 0" armature="0.1"/><geom size=".05" pos="0 0 -.2" mass="1"/></body>
  </worldbody>
  <actuator>
    <plugin name="a" joint="first" plugin="tribotwin.drive" instance="a" actdim="3" dyntype="user"/>
    <plugin name="b" joint="second" plugin="tribotwin.drive" instance="b" actdim="STATES" dyntype="user"/>
  </actuator></mujoco>)";
  text.replace(text.find("WINDING"), 7, winding);
  text.replace(text.find("STATES"), 6, winding.empty() ? "3" : "6");
  const auto model = mujoco::load_string(text);
  EXPECT_TRUE(model.has_value()) << model.error().message;
  return *model;
}

/// Torque [Nm] of both drives after each of some steps at rest, their goals 1 rad away.
std::vector<std::vector<double>> torques(Servo& servo, const mujoco::Model& model, mjData* d, int steps) {
  std::vector<std::vector<double>> all(2);
  const SetPoint goals[] = {{1, 0}, {1, 0}};
  for (int k = 0; k < steps; ++k) {
    servo.control(model.get(), d, goals);
    for (std::size_t i = 0; i < 2; ++i) all[i].push_back(d->ctrl[model.drives()[i].control] * model.drives()[i].gear);
  }
  return all;
}

TEST(DcPosition, DutyHasALimitAndARateOfEachDrive) {
  const auto model = two_joints();
  const auto d = model->make_data();
  mj_forward(model->get(), d.get());
  DcPositionOptions limited{.kp = 1, .error_gain = 1, .duty_limit = 0.5, .supply_V = 10, .resistance_ohm = 2};
  DcPositionOptions slow = limited;
  slow.duty_limit = 1, slow.duty_slew_1_s = 100;
  const auto servo = make_dc_position(*model, {limited, slow});
  const auto torque = torques(*servo, *model, d.get(), 3);
  for (int k = 0; k < 3; ++k) {
    EXPECT_DOUBLE_EQ(torque[0][k], 0.5 * 10 / 2);
    EXPECT_DOUBLE_EQ(torque[1][k], 0.1 * (k + 1) * 10 / 2);
  }
}

TEST(DcPosition, GainsBendAtTheirKnots) {
  GainCurve curve;
  EXPECT_EQ(curve(3), 1);
  curve.at = {1, 2, 4, GainCurve::none[0]};
  curve.factor = {0.5, GainCurve::none[0], 3, GainCurve::none[0]};
  for (const auto& [x, factor] : {std::pair{0.0, 0.5}, {1.0, 0.5}, {1.5, 0.75}, {2.0, 1.0}, {3.0, 2.0}, {9.0, 3.0}})
    EXPECT_DOUBLE_EQ(curve(x), factor) << x;
  DcPositionOptions o{.kp = 3, .error_gain = 0.01, .supply_V = 10, .resistance_ohm = 2};
  EXPECT_DOUBLE_EQ(dc_torque_nm(o, -1.5, 0), -3 * 0.01 * 1.5 * 10 / 2);
  o.over_kp = o.over_error = curve;
  EXPECT_DOUBLE_EQ(dc_torque_nm(o, -1.5, 0), -3 * 2 * 0.01 * 0.75 * 1.5 * 10 / 2);
}

TEST(Cascaded, FollowsWhatItsModeSays) {
  const auto model = two_joints();
  const auto d = model->make_data();
  mj_forward(model->get(), d.get());
  CascadedOptions o{.gravity = false, .per_drive = std::vector<LoopGains>(2)};
  for (LoopGains& g : o.per_drive)
    g = {.position_gain_1_s = 5, .integral_time_s = 0, .speed_gain_nm_s_rad = 0.01, .torque_gain = 0.5};
  const SetPoint command{.position_rad = 1, .velocity_rad_s = 2, .torque_nm = 0.03};
  const SetPoint commands[] = {command, command};
  using Mode = DriveCommand::Mode;
  for (const auto& [mode, torque_nm] :
       {std::pair{Mode::position, 0.01 * (5 + 2) + 0.015}, {Mode::velocity, 0.01 * 2 + 0.015}, {Mode::torque, 0.015}}) {
    o.mode = mode;
    make_cascaded(*model, d.get(), o)->control(model->get(), d.get(), commands);
    EXPECT_NEAR(d->ctrl[model->drives()[1].control] * model->drives()[1].gear, torque_nm, 1e-12);
  }
}

TEST(DcPosition, AWarmWindingHasMoreResistance) {
  const auto model = two_joints();
  const auto d = model->make_data();
  for (const auto& drive : model->drives()) drive::set_temperature(drive.drive, mujoco::state(d.get(), drive), 65);
  mj_forward(model->get(), d.get());
  DcPositionOptions cold{.kp = 1, .error_gain = 1, .supply_V = 10, .resistance_ohm = 2};
  DcPositionOptions warm = cold;
  warm.resistance_per_K = 0.004;
  const auto torque = torques(*make_dc_position(*model, {cold, warm}), *model, d.get(), 1);
  EXPECT_DOUBLE_EQ(torque[0][0], 5);
  EXPECT_NEAR(torque[1][0], 5 / 1.16, 1e-12);
}

/// The gear stays at 25 degC; the winding has 65. Its magnets are weaker then: so is the voltage of the motion.
TEST(DcPosition, AWindingHasItsOwnTemperature) {
  const auto model = two_joints(R"(
      <config key="winding_resistance_ohm" value="2"/><config key="torque_constant_nm_A" value="0.1"/>
      <config key="winding_heat_capacity_J_K" value="5"/><config key="winding_thermal_resistance_K_W" value="0.4"/>
      <config key="winding_magnet_1_K" value="0.002"/><config key="winding_reference_degC" value="25"/>)");
  const auto d = model->make_data();
  const auto& motor = model->drives()[1];
  for (const auto& drive : model->drives()) drive::set_temperature(drive.drive, mujoco::state(d.get(), drive), 25);
  drive::set_winding(motor.drive, mujoco::state(d.get(), motor), 65);
  mj_forward(model->get(), d.get());
  DcPositionOptions o{.kp = 1, .error_gain = 1, .supply_V = 10, .resistance_ohm = 2, .kt_nm_A = 1};
  o.resistance_per_K = 0.004;
  const auto torque = torques(*make_dc_position(*model, {o, o}), *model, d.get(), 1);
  EXPECT_NEAR(torque[0][0], 5, 1e-6);
  EXPECT_NEAR(torque[1][0], 5 / 1.16, 1e-12);
  d->qvel[motor.dof] = 3;
  EXPECT_NEAR(torques(*make_dc_position(*model, {o, o}), *model, d.get(), 1)[1][0], (10 - 0.92 * 3) / 2.32, 1e-12);
}

TEST(Cascaded, EachDriveHasItsOwnGainsAndLimit) {
  const auto model = two_joints();
  const auto d = model->make_data();
  mj_forward(model->get(), d.get());
  CascadedOptions options{.gravity = false};
  options.per_drive = {
      {.position_gain_1_s = 3, .integral_time_s = 0, .speed_gain_nm_s_rad = 0.5},
      {.position_gain_1_s = 3, .integral_time_s = 0, .speed_gain_nm_s_rad = 0.5, .torque_limit_nm = 1.2}};
  const auto torque = torques(*make_cascaded(*model, d.get(), options), *model, d.get(), 2);
  for (int k = 0; k < 2; ++k) {
    EXPECT_DOUBLE_EQ(torque[0][k], 1.5);
    EXPECT_DOUBLE_EQ(torque[1][k], 1.2);
  }
}

}  // namespace
}  // namespace tribotwin::twin
