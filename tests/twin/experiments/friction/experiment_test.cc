#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/twin/experiments/friction/experiment.hpp>

namespace tribotwin::twin {
namespace {

class Experiment : public testing::Test {
 protected:
  std::shared_ptr<const mujoco::Model> model = mujoco::load_file(TRIBOTWIN_SOURCE_DIR "/mjcf/irb6620.xml").value();
  const drive::Drive& drive = model->drives()[1].drive;
  const std::vector<double> speeds{1, 5, 12, 40, 100, 190, 280};
};

TEST_F(Experiment, MeasuresTheLawWithTheLoadHeldByATorque) {
  for (const double T : {40.0, 60.0, 80.0})
    for (const double load : {0.0, 0.3, 0.7}) {
      const auto measured = measure_curve(*model, 1, speeds, {.load_norm = load, .temperature_degC = T});
      ASSERT_TRUE(measured) << measured.error().message;
      const auto law = law_curve(drive, speeds, load, T);
      for (std::size_t i = 0; i < speeds.size(); ++i)
        EXPECT_NEAR((*measured)[i].friction_nm, law[i].friction_nm, 1e-3 * law[i].friction_nm)
            << T << " degC, load " << load << ", " << speeds[i] << " rad/s";
    }
}

TEST_F(Experiment, MeasuresTheLawWithTheLoadHeldByAPose) {
  for (const double T : {40.0, 60.0, 80.0})
    for (const double load : {-0.5, -0.1, 0.3}) {
      const auto measured =
          measure_curve(*model, 1, speeds, {.load_norm = load, .temperature_degC = T, .load_by = LoadBy::pose});
      ASSERT_TRUE(measured) << measured.error().message;
      for (std::size_t i = 0; i < speeds.size(); ++i) {
        const double law = law_curve(drive, {&speeds[i], 1}, (*measured)[i].load_norm, T)[0].friction_nm;
        EXPECT_NEAR((*measured)[i].friction_nm, law, 5e-3 * law)
            << T << " degC, load " << load << ", " << speeds[i] << " rad/s";
        EXPECT_NEAR((*measured)[i].load_norm, load, 0.01);
      }
    }
}

TEST_F(Experiment, NoiseShowsInTheStandardErrorAndRepeatsWithTheSeed) {
  const std::vector<double> one{50};
  const auto a = measure_curve(*model, 1, one, {.noise_nm = 20, .seed = 7}),
             b = measure_curve(*model, 1, one, {.noise_nm = 20, .seed = 7}),
             c = measure_curve(*model, 1, one, {.noise_nm = 20, .seed = 8});
  EXPECT_EQ((*a)[0].friction_nm, (*b)[0].friction_nm);
  EXPECT_NE((*a)[0].friction_nm, (*c)[0].friction_nm);
  EXPECT_NEAR((*a)[0].stderr_nm, 20 / std::sqrt(2 * 150.0), 0.4);  // 0.5 s or more at 250 Hz, both ways
  EXPECT_NEAR((*a)[0].friction_nm, law_curve(drive, one, 0, 50)[0].friction_nm, 4 * (*a)[0].stderr_nm);
}

TEST_F(Experiment, SaysWhichLoadsAPoseCanGive) {
  EXPECT_THAT(measure_curve(*model, 1, speeds, {.load_norm = 0.72, .load_by = LoadBy::pose}).error().message,
              testing::HasSubstr("-0.583 .. 0.541"));
}

/// Torques are those of the current: at the joint's temperature the magnets of the motor are 8 % weaker, and friction
/// and load look 1 / 0.92 as large. The winding keeps its temperature here.
TEST(Windings, HaveTheTemperatureOfTheJoint) {
  const auto arm = [](const std::string& winding, const char* states) {
    const auto model = mujoco::load_string(fmt::format(R"(<mujoco><option timestep="0.001"/>
  <extension><plugin plugin="tribotwin.drive"><instance name="j"><config key="law" value="stribeck"/>
    <config key="Fc" value="0.03"/><config key="Fs" value="0.02"/><config key="Fv" value="4e-4"/>
    <config key="vs" value="10"/><config key="alpha" value="1.3"/><config key="torque_max_nm" value="100"/>
    <config key="gear_ratio" value="50"/>{}</instance></plugin></extension>
  <worldbody><body><joint name="hinge" axis="0 1 0" armature="2" frictionloss="1" solreffriction=".001 1"
    solimpfriction=".9999 .9999 .001 .5 2"/><geom type="sphere" size=".1" mass="4"/></body></worldbody>
  <actuator><plugin name="drive" joint="hinge" plugin="tribotwin.drive" instance="j" actdim="{}" dyntype="user"/>
  </actuator></mujoco>)",
                                                       winding, states));
    EXPECT_TRUE(model) << model.error().message;
    return *model;
  };
  const std::vector<double> speeds{20, 60};
  const ExperimentOptions options{.load_norm = 0.2, .temperature_degC = 65};
  const auto plain = measure_curve(*arm("", "3"), 0, speeds, options);
  const auto warm = measure_curve(*arm(R"(<config key="winding_resistance_ohm" value="1e-6"/>
    <config key="torque_constant_nm_A" value="0.1"/><config key="winding_heat_capacity_J_K" value="1e6"/>
    <config key="winding_thermal_resistance_K_W" value="1e3"/><config key="winding_magnet_1_K" value="0.002"/>
    <config key="winding_reference_degC" value="25"/>)",
                                       "6"),
                                  0, speeds, options);
  ASSERT_TRUE(plain && warm);
  for (std::size_t i = 0; i < speeds.size(); ++i) {
    EXPECT_NEAR((*warm)[i].friction_nm, (*plain)[i].friction_nm / 0.92, 1e-3 * (*plain)[i].friction_nm);
    EXPECT_NEAR((*warm)[i].load_norm, 0.2 / 0.92, 1e-3);
  }
}

}  // namespace
}  // namespace tribotwin::twin
