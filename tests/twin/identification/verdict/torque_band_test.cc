#include <algorithm>
#include <cmath>
#include <random>

#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/tests/twin/identification/swing_recording.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>
#include <tribotwin/twin/identification/rigid_body/training_range.hpp>
#include <tribotwin/twin/identification/verdict/torque_band.hpp>

/// An arm that is recorded twice: the band of the first motion against the torques of the second.
namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

struct Case {
  const char* name;
  double length_s;
  double noise_nm;
  double outliers;   ///< share of samples with ten times the noise
  double ripple_nm;  ///< by position, which no parameter explains
  Robust robust = Robust::none;
};

class Arm {
 public:
  RobotRecording recording(unsigned seed, const Case& c) {
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform;
    return swing_recording(seed, 2, static_cast<Index>(c.length_s * 100), [&](const auto& state, auto& random) {
      const auto& [q, qd, qdd] = state;
      VectorXd torque = regressor_.at(q, qd, qdd) * regressor_.model_parameters();
      for (Index j = 0; j < 2; ++j)
        torque(j) = torque(j) + std::copysign(2.0, qd(j)) + qd(j) + c.ripple_nm * std::sin(9 * q(j)) +
                    (uniform(random) < c.outliers ? 10 : 1) * c.noise_nm * normal(random);
      return torque;
    });
  }

  /// Of both joints and twenty pairs of motions: the samples of the second in the training, and those within the band
  /// of the first, half and twice that width.
  struct InBands {
    InBand half, band, twice;
  };
  InBands in_bands(const Case& c) {
    InBands all;
    for (unsigned seed = 1; seed <= 20; ++seed) {
      const JointMotion trained = motion(seed, c), other = motion(seed + 100, c);
      const auto fit = fit_dynamics(regressor_, base_, friction_, trained, {.robust = c.robust, .folds = band_folds});
      EXPECT_TRUE(fit) << fit.error().message;
      const VectorXd half_width = band_of(trained, fit->held_out);
      const auto load = [&](const JointMotion& m) { return gear_load(regressor_, base_, fit->parameters.base, m, 1); };
      const auto counts = in_training(ranges_of(trained, load(trained), false), other, load(other), false);
      const MatrixXd predicted = predicted_torque(regressor_, base_, friction_, fit->parameters, other, 1);
      for (const auto& [band, factor] : {std::pair{&all.half, 0.5}, {&all.band, 1.0}, {&all.twice, 2.0}})
        for (Index j = 0; j < 2; ++j)
          for (Index i = 0; i < other.size(); ++i)
            if (counts(j, i))
              ++band->samples, band->inside += std::abs(other.torque(j, i) - predicted(j, i)) <= factor * half_width(j);
    }
    return all;
  }

 private:
  JointMotion motion(unsigned seed, const Case& c) {
    const RobotRecording one = recording(seed, c);
    return *prepare({&one, 1}, regressor_);
  }

  std::shared_ptr<const mujoco::Model> model_ = *mujoco::load_string(R"(<mujoco><worldbody>
    <body name="upper"><joint name="shoulder" axis="0 1 0" armature=".05"/>
      <geom type="capsule" size=".05" fromto="0 0 0 .4 0 0" mass="4"/>
    <body name="fore" pos=".4 0 0"><joint name="elbow" axis="0 0 1" armature=".01"/>
      <geom type="box" size=".1 .04 .03" pos=".1 .01 0" mass="1"/></body></body></worldbody></mujoco>)");
  Regressor regressor_ = *Regressor::create(model_->get());
  BaseParameters base_ = base_parameters(regressor_);
  RobotFriction friction_ = *robot_friction(*model_, regressor_, coulomb_viscous());
};

class TorqueBand : public testing::TestWithParam<Case> {};

TEST_P(TorqueBand, Holds95PercentOfAnotherMotionsTorques) {
  const auto [half, band, twice] = Arm().in_bands(GetParam());
  RecordProperty("share_inside", std::to_string(band.share()));
  EXPECT_GT(band.samples, 10'000);
  EXPECT_GT(band.share(), 0.93);
  EXPECT_LT(band.share(), 0.97);
  EXPECT_LT(half.share(), 0.93);
  EXPECT_GT(twice.share(), 0.97);
}

INSTANTIATE_TEST_SUITE_P(Torques, TorqueBand,
                         testing::Values(Case{"Noise", 60, 1, 0, 0}, Case{"Ripple", 60, 0.2, 0, 2},
                                         Case{"FewSamples", 12, 1, 0, 0}, Case{"FewSamplesRipple", 12, 0.2, 0, 2},
                                         Case{"Outliers", 60, 0.5, 0.02, 0, Robust::huber}),
                         [](const auto& info) { return info.param.name; });

TEST(TorqueBand, IsTheErrorThat95PercentOfTheSamplesInMotionDoNotExceed) {
  JointMotion m;
  m.torque = MatrixXd::Zero(2, 2001), m.q = m.qd = m.torque;
  m.moving.setConstant(2, 2001, true);
  m.moving.row(1).setConstant(false);
  m.torque.row(0) = VectorXd::LinSpaced(2001, -1, 1);
  m.moving(0, 1000) = false, m.torque(0, 1000) = 1e6;  // at rest
  const VectorXd band = band_of(m, MatrixXd::Zero(2, 2001));
  EXPECT_NEAR(band(0), 0.95, 2e-3);
  EXPECT_TRUE(std::isnan(band(1)));
}

TEST(TorqueBand, FailsWhereTwiceAsManyAreOutside) {
  EXPECT_FALSE((InBand{.samples = 1000, .inside = 905}.fails()));
  EXPECT_TRUE((InBand{.samples = 1000, .inside = 895}.fails()));
  EXPECT_FALSE((InBand{.samples = 10, .inside = 2}.fails()));  // of so few it says nothing
  EXPECT_FALSE(InBand{}.fails());
}

// Of 62 samples of one slow swing next to nothing is known, of as many independent ones enough.
TEST(TorqueBand, IsRefutedByIndependentSamplesOnly) {
  EXPECT_TRUE((InBand{.samples = 62, .inside = 22, .independent = 62}.is_refuted()));
  EXPECT_FALSE((InBand{.samples = 62, .inside = 22, .independent = 3}.is_refuted()));
  EXPECT_FALSE((InBand{.samples = 62, .inside = 60, .independent = 62}.is_refuted()));
}

TEST(TorqueBand, CountsCorrelatedErrorsAsFewIndependentOnes) {
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  std::vector<double> white(2000), slow(2000);
  for (std::size_t i = 0; i < white.size(); ++i)
    white[i] = normal(random), slow[i] = std::sin(0.01 * static_cast<double>(i)) + 0.01 * white[i];
  JointMotion m;
  m.cutoff_hz = 20, m.period_s = 0.01;
  EXPECT_NEAR(independent_errors(white, m), 400, 1);  // no more than one per period of the cut-off
  EXPECT_LT(independent_errors(slow, m), 40);
  EXPECT_EQ(independent_errors({}, m), 0);
}

TEST(TorqueBand, IsProvenByTheIndependentSamplesThatItIsOf) {
  JointMotion m;
  m.torque.resize(2, 2000), m.q = MatrixXd::Zero(2, 2000), m.cutoff_hz = 20, m.period_s = 0.01;
  m.moving.setConstant(2, 2000, true);
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  for (Index i = 0; i < 2000; ++i)
    m.torque(0, i) = normal(random), m.torque(1, i) = std::sin(0.004 * static_cast<double>(i));
  const VectorXd of = independent_of_band(m, MatrixXd::Zero(2, 2000));
  EXPECT_GT(of(0), least_of_band);
  EXPECT_LT(of(1), least_of_band);
}

}  // namespace
}  // namespace tribotwin::twin::identification
