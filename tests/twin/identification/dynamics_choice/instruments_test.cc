// A robot of two joints that repeats its motion, with an encoder so coarse that least squares are biased.
#include <algorithm>
#include <cmath>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/tests/twin/identification/multisine.hpp>
#include <tribotwin/twin/identification/dynamics_choice/repetitions.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::VectorXd;

struct Recorded {
  double step_rad = 2 * M_PI / 8192;  ///< of the encoder; 0: exact
  double noise_nm = 0.3;
  double period_s = 3.1007, length_s = 12.6;
  bool repeats = true;
  double rest_s = 0;  ///< before and after the motion
};

class Arm {
 public:
  static constexpr double coulomb_nm[] = {3, 1}, viscous_nm_s[] = {2, 0.5};

  explicit Arm(const friction::LawInfo& law = coulomb_viscous())
      : friction_(*robot_friction(*model_, regressor_, law, {.offset = true}, std::vector<double>{50, 20})) {}

  RobotRecording recording(const Recorded& d, unsigned seed) {
    constexpr double rate_hz = 500;
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    const double base_hz = 1 / d.period_s;
    const Multisine swing(
        2, random,
        {.first_hz = base_hz, .next_hz = d.repeats ? base_hz : 0.37 * base_hz, .per_joint_hz = 0, .sines = 5});
    const auto samples = static_cast<Index>(d.length_s * rate_hz);
    RobotRecording r{.file = "arm.csv"};
    r.position.resize(2, samples), r.torque.resize(2, samples);
    const VectorXd phi = regressor_.model_parameters();
    for (Index i = 0; i < samples; ++i) {
      r.time_s.push_back(static_cast<double>(i) / rate_hz);
      const auto [q, qd, qdd] = swing.at(std::clamp(r.time_s.back() - d.rest_s, 0.0, d.length_s - 2 * d.rest_s));
      r.torque.col(i) = regressor_.at(q, qd, qdd) * phi;
      for (Index j = 0; j < 2; ++j) {
        r.torque(j, i) += std::copysign(coulomb_nm[j], qd(j)) + viscous_nm_s[j] * qd(j) + d.noise_nm * normal(random);
        r.position(j, i) = d.step_rad > 0 ? d.step_rad * std::round(q(j) / d.step_rad) : q(j);
      }
    }
    return r;
  }

  VectorXd truth() const { return base_.from_all * regressor_.model_parameters(); }

  Result<DynamicsFit> fitted(const RobotRecording& r, bool instrumental, DynamicsOptions options = {}) {
    auto motion = prepare({&r, 1}, regressor_, {.cutoff_hz = 40});
    if (!motion) return tl::unexpected(motion.error());
    options.threads = 1;
    Instruments z;
    if (instrumental) {
      auto found = instruments_of_repetitions({&r, 1}, regressor_, *motion);
      if (!found) return tl::unexpected(found.error());
      z = std::move(*found);
      options.instruments = &z;
    }
    return fit_dynamics(regressor_, base_, friction_, *motion, options);
  }

 private:
  std::shared_ptr<const mujoco::Model> model_ = *mujoco::load_string(R"(<mujoco><worldbody>
  <body><joint name="shoulder" axis="0 1 0" armature=".3"/><geom type="capsule" size=".05" fromto="0 0 0 .4 0 0"
    mass="4"/>
  <body pos=".4 0 0"><joint name="elbow" axis="0 1 0" armature=".1"/>
    <geom type="capsule" size=".04" fromto="0 0 0 .3 0 .05" mass="2"/></body></body></worldbody></mujoco>)");
  Regressor regressor_ = *Regressor::create(model_->get());
  BaseParameters base_ = base_parameters(regressor_);
  RobotFriction friction_;
};

/// Over seeds: the largest bias of a base parameter in its mean sigma, and the share of 95 % intervals that hold.
struct Trial {
  double bias_sigmas, covered;
};

Trial trial(Arm& arm, bool instrumental, unsigned seeds, const Recorded& recorded = {}) {
  const VectorXd truth = arm.truth();
  VectorXd error = VectorXd::Zero(truth.size()), sigma = error;
  double inside = 0, all = 0;
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    const auto fit = arm.fitted(arm.recording(recorded, seed), instrumental);
    EXPECT_TRUE(fit) << fit.error().message;
    for (Index k = 0; k < truth.size(); ++k) {
      const Estimate& e = fit->base[static_cast<std::size_t>(k)];
      if (e.status != Status::estimated) continue;
      error(k) += e.value - truth(k), sigma(k) += e.sigma;
      inside += e.low <= truth(k) && truth(k) <= e.high, ++all;
    }
  }
  return {error.cwiseQuotient(sigma).cwiseAbs().maxCoeff(), inside / all};
}

TEST(Instruments, TakeTheBiasOfACoarseEncoderFromInertias) {
  Arm arm;
  const Trial least_squares = trial(arm, false, 20), instrumental = trial(arm, true, 20);
  fmt::print("least squares: bias {:.2f} sigma, {:.3f} covered; instrumental variables: {:.2f}, {:.3f}\n",
             least_squares.bias_sigmas, least_squares.covered, instrumental.bias_sigmas, instrumental.covered);
  EXPECT_GT(least_squares.bias_sigmas, 3);
  EXPECT_LT(least_squares.covered, 0.7);
  EXPECT_LT(instrumental.bias_sigmas, 1);
  EXPECT_GT(instrumental.covered, 0.9);
}

// 1550.5 samples: every second repetition has the errors of the first.
TEST(Instruments, AreNoRepetitionsWithTheSameErrors) {
  Arm arm;
  const Recorded recorded{.period_s = 3.101};
  const Trial instrumental = trial(arm, true, 10, recorded);
  EXPECT_LT(instrumental.bias_sigmas, 1);
  EXPECT_GT(instrumental.covered, 0.9);
  const auto fit = arm.fitted(arm.recording(recorded, 1), true);
  ASSERT_TRUE(fit) << fit.error().message;
  EXPECT_THAT(fit->notes, testing::Contains(testing::HasSubstr("without those in which the encoder's errors are")));
}

// What is in both fits' torques is the filter's and the noise's alone.
TEST(Instruments, AreLeastSquaresWithoutErrorsOfPositions) {
  Arm arm;
  const RobotRecording recording = arm.recording({.step_rad = 0}, 1);
  const auto least_squares = arm.fitted(recording, false), instrumental = arm.fitted(recording, true);
  ASSERT_TRUE(least_squares && instrumental);
  EXPECT_EQ(estimator_of(*least_squares), "least_squares");
  EXPECT_EQ(estimator_of(*instrumental), "instrumental_variables");
  EXPECT_THAT(instrumental->notes, testing::Contains(testing::HasSubstr("4.05 times every 3.1007 s")));
  const VectorXd truth = arm.truth();
  for (std::size_t k = 0; k < instrumental->base.size(); ++k) {
    const Estimate &a = least_squares->base[k], &b = instrumental->base[k];
    EXPECT_NEAR(a.value, b.value, std::min(a.sigma, b.sigma)) << a.name;
    EXPECT_NEAR(b.value, truth(static_cast<Index>(k)), 4 * b.sigma) << b.name;
    EXPECT_LT(b.sigma, 3 * a.sigma) << b.name;
  }
}

TEST(Instruments, AreRefusedWhereTheyTellNothing) {
  struct Case {
    std::string name;
    Recorded recorded;
    DynamicsOptions options;
    std::string message;
  };
  const Case cases[] = {
      {"no period", {.repeats = false}, {}, "no motion is repeated"},
      {"less than a period and a quarter", {.length_s = 3.5}, {}, "no motion is repeated"},
      {"home at either end", {.period_s = 7.4, .rest_s = 2.6}, {}, "no motion is repeated"},
      {"errors repeat", {.period_s = 3.1}, {}, "joint shoulder repeats its positions within 0 of its encoder's step"},
      {"too short", {.period_s = 0.5003}, {}, "need 160"},
      {"robust", {}, {.robust = Robust::huber}, "no robust loss"},
      {"prior", {}, {.prior = 0.1}, "no robust loss, prior"},
      {"elimination", {}, {.essential_only = true}, "elimination"},
      {"evidence", {}, {.evidence = true}, "prior"},
      {"lag", {}, {.lag = true}, "lag"},
      {"folds", {}, {.folds = 5}, "folds"},
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(c.name);
    Arm arm;
    const auto fit = arm.fitted(arm.recording(c.recorded, 1), true, c.options);
    ASSERT_FALSE(fit);
    EXPECT_THAT(fit.error().message, testing::HasSubstr(c.message));
  }
  Arm loaded(coulomb_viscous_load());
  const auto fit = loaded.fitted(loaded.recording({}, 1), true);
  ASSERT_FALSE(fit);
  EXPECT_THAT(fit.error().message, testing::HasSubstr("knows no load"));
}

}  // namespace
}  // namespace tribotwin::twin::identification
