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

}  // namespace
}  // namespace tribotwin::twin
