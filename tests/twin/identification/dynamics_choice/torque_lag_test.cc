// Torques of a robot of two joints, recorded later or earlier than its positions by a known time.
#include <cmath>
#include <random>
#include <utility>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/tests/twin/identification/multisine.hpp>
#include <tribotwin/twin/identification/dynamics_choice/torque_lag.hpp>
#include <tribotwin/twin/numerics/filter.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::VectorXd;

struct Recorded {
  double lag_s[2];
  double noise_memory = 0;  ///< correlation of the torques' noise from one sample to the next
  double ripple = 0;        ///< of the torque, which nothing models
  double offset_only = 0;   ///< 1: the elbow's torque is noise about an offset
  double encoder_rad = 0;   ///< step of the encoders; 0: noise of 1e-5 rad
  double shake_rad = 0;     ///< at 9 Hz beside the swing
  double early_s = 0;       ///< of the shoulder's torque above 3 Hz
};

class Arm {
 public:
  const Regressor& regressor() const { return regressor_; }

  RobotRecording recording(const Recorded& d, unsigned seed, double length_s = 10, double rate_hz = 125) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    const Multisine swing(2, random);
    const auto samples = static_cast<Index>(length_s * rate_hz);
    RobotRecording r{.file = "arm.csv"};
    r.position.resize(2, samples), r.torque.resize(2, samples);
    double noise[2] = {0, 0};
    for (Index i = 0; i < samples; ++i) {
      const double t = static_cast<double>(i) / rate_hz;
      const auto s = moved(swing, d, t);
      r.time_s.push_back(t);
      for (Index j = 0; j < 2; ++j) {
        const double memory = d.noise_memory;
        noise[j] = memory * noise[j] + 0.3 * std::sqrt(1 - memory * memory) * normal(random);
        r.position(j, i) = s.q(j) + 1e-5 * normal(random);
        if (d.encoder_rad > 0) r.position(j, i) = d.encoder_rad * std::round(s.q(j) / d.encoder_rad);
        const double torque = torque_of(moved(swing, d, t - d.lag_s[j]), j);
        r.torque(j, i) = torque * (1 + d.ripple * std::sin(37 * s.q(j))) + noise[j];
        if (j == 1 && d.offset_only > 0) r.torque(j, i) = 5 + noise[j];
      }
    }
    if (d.early_s > 0) advance_fast(r, static_cast<Index>(d.early_s * rate_hz), rate_hz);
    return r;
  }

  Result<TorqueLag> found(const std::vector<RobotRecording>& recordings, const Preparation& preparation = {},
                          LagOf of = LagOf::joint) const {
    const auto fit = [&](JointMotion& motion) {
      return fit_dynamics(regressor_, base_, friction_, motion, {.lag = true, .threads = 1});
    };
    return torque_lag(recordings, regressor_, preparation, fit, of);
  }

 private:
  static Multisine::State moved(const Multisine& swing, const Recorded& d, double time_s) {
    Multisine::State s = swing.at(time_s);
    const double w = 2 * M_PI * 9, x = w * time_s;
    s.q.array() += d.shake_rad * std::sin(x), s.qd.array() += d.shake_rad * w * std::cos(x);
    s.qdd.array() -= d.shake_rad * w * w * std::sin(x);
    return s;
  }

  static void advance_fast(RobotRecording& r, Index samples, double rate_hz) {
    const VectorXd torque = r.torque.row(0);
    const std::vector<double> slow =
        low_passed(std::span(torque.data(), static_cast<std::size_t>(torque.size())), rate_hz, 3);
    for (Index i = 0; i + samples < torque.size(); ++i) {
      const auto at = static_cast<std::size_t>(i), then = static_cast<std::size_t>(i + samples);
      r.torque(0, i) = slow[at] + torque(i + samples) - slow[then];
    }
  }

  double torque_of(const Multisine::State& s, Index j) {
    return (regressor_.at(s.q, s.qd, s.qdd) * phi_)(j) + std::copysign(4, s.qd(j)) + 2 * s.qd(j);
  }

  std::shared_ptr<const mujoco::Model> model_ = *mujoco::load_string(R"(<mujoco><worldbody>
    <body name="upper"><joint name="shoulder" axis="0 1 0" armature=".4"/>
      <geom type="capsule" size=".05" fromto="0 0 0 .5 0 0" mass="6"/>
    <body name="fore" pos=".5 0 0"><joint name="elbow" axis="0 1 0" armature=".2"/>
      <geom type="capsule" size=".04" fromto="0 0 0 .4 0 0" mass="3"/></body></body>
    </worldbody></mujoco>)");
  Regressor regressor_ = *Regressor::create(model_->get());
  BaseParameters base_ = base_parameters(regressor_);
  RobotFriction friction_ = *robot_friction(*model_, regressor_, coulomb_viscous());
  VectorXd phi_ = regressor_.model_parameters();
};

TEST(TorqueLag, IsFoundPerJointWithinItsSigmas) {
  Arm arm;
  const std::pair<Recorded, Preparation> cases[] = {{{{0, 0}}, {}},
                                                    {{{0.003, -0.002}}, {}},
                                                    {{{0.04, 0}}, {}},
                                                    {{{0.003, -0.002}}, {.reversals = true}},
                                                    {{{0.003, -0.002}, 0.9, 0.02}, {}}};
  int covered = 0, all = 0;
  for (const auto& [recorded, preparation] : cases)
    for (unsigned seed = 1; seed <= 8; ++seed) {
      const auto found = arm.found({arm.recording(recorded, seed)}, preparation);
      ASSERT_TRUE(found) << found.error().message;
      for (std::size_t j = 0; j < 2; ++j) {
        const Estimate& e = found->lag[j];
        if (e.status == Status::held) continue;
        const double truth = recorded.lag_s[j];
        EXPECT_NEAR(e.value, truth, 4 * e.sigma) << e.name << ", seed " << seed;
        covered += e.low < truth && truth < e.high, ++all;
        if (recorded.noise_memory == 0) EXPECT_LT(e.sigma, 0.004) << e.name << ", seed " << seed;
      }
    }
  EXPECT_GE(all, 74);  // the others are hidden by correlated noise
  EXPECT_GE(covered, 0.88 * all);
}

/// Noise of the slopes makes each step of Gauss-Newton a tenth of what is missing.
TEST(TorqueLag, IsFoundThroughACoarseEncoder) {
  Arm arm;
  for (unsigned seed = 1; seed <= 4; ++seed) {
    const auto found =
        arm.found({arm.recording({.lag_s = {0.02, 0.02}, .encoder_rad = 2 * M_PI / 8192}, seed)}, {.cutoff_hz = 8});
    ASSERT_TRUE(found) << found.error().message;
    EXPECT_EQ(found->lag[0].status, Status::estimated) << testing::PrintToString(found->notes);
    EXPECT_LT(found->lag[0].sigma, 0.005) << "seed " << seed;
    for (const Estimate& e : found->lag) {
      if (e.status == Status::held) continue;
      EXPECT_NEAR(e.value, 0.02, 3 * e.sigma) << e.name << ", seed " << seed;
    }
  }
}

TEST(TorqueLag, ThatOnlyFastMotionShowsIsNone) {
  Arm arm;
  const Recorded recorded{.lag_s = {0, 0.003}, .shake_rad = 0.0003, .early_s = 0.016};
  const auto found = arm.found({arm.recording(recorded, 3)}, {.cutoff_hz = 10});
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_EQ(found->lag[0].status, Status::held) << found->lag[0].value << " +- " << found->lag[0].sigma;
  EXPECT_THAT(found->notes, testing::Contains(testing::HasSubstr("a delay is the same at all frequencies")));
  EXPECT_EQ(found->lag[1].status, Status::estimated);
}

/// As if the torques had been on time.
TEST(TorqueLag, LeavesNoErrorInTheParameters) {
  Arm arm;
  const auto late = arm.recording({.lag_s = {0.008, 0.008}}, 3);
  const auto found = arm.found({late});
  ASSERT_TRUE(found) << found.error().message;
  const auto on_time = arm.found({arm.recording({.lag_s = {0, 0}}, 3)});
  for (std::size_t k = 0; k < found->fit.base.size(); ++k)
    EXPECT_NEAR(found->fit.base[k].value, on_time->fit.base[k].value, found->fit.base[k].sigma)
        << found->fit.base[k].name;
  EXPECT_NEAR(found->fit.relative_error, on_time->fit.relative_error, 0.1 * on_time->fit.relative_error);
}

/// Joints of the same lag differ by chance in 95 % of recordings; their mean is the lag, within its sigmas.
TEST(TorqueLag, OfTheRobotIsTheMeanOfItsJoints) {
  constexpr int recordings = 40, alike_least = 35, within_least = 34;  // 1 in 100 times fewer
  Arm arm;
  int alike = 0, within = 0;
  for (unsigned seed = 1; seed <= recordings; ++seed) {
    const auto own = arm.found({arm.recording({.lag_s = {0.008, 0.008}}, seed)});
    ASSERT_TRUE(own);
    if (!own->alike) continue;
    ++alike, within += std::abs(own->alike->value - 0.008) < 2 * own->alike->sigma;
    for (const Estimate& e : own->lag) EXPECT_LE(own->alike->sigma, e.sigma) << e.name;
  }
  EXPECT_GE(alike, alike_least);
  EXPECT_GE(within, within_least);
}

/// Also of the joint that does not show its own.
TEST(TorqueLag, OfTheRobotIsEachJoints) {
  Arm arm;
  for (const double offset_only : {0, 1}) {
    const auto late = arm.recording({.lag_s = {0.008, 0.008}, .offset_only = offset_only}, 4);
    const auto own = arm.found({late}), one = arm.found({late}, {}, LagOf::robot);
    ASSERT_TRUE(own && one);
    ASSERT_TRUE(own->alike);
    for (std::size_t j = 0; j < 2; ++j) {
      EXPECT_EQ(one->lag[j].value, own->alike->value);
      EXPECT_EQ(one->lag[j].status, Status::estimated);
      EXPECT_EQ(one->motion.lag_s[j], own->alike->value);
    }
    EXPECT_EQ(one->lag[1].name, "elbow");
    EXPECT_TRUE(one->notes.empty()) << testing::PrintToString(one->notes);
  }
}

TEST(TorqueLag, OfJointsThatDifferIsTheirOwn) {
  Arm arm;
  const auto late = arm.recording({.lag_s = {0.012, -0.008}}, 3);
  const auto own = arm.found({late}), one = arm.found({late}, {}, LagOf::robot);
  ASSERT_TRUE(own && one);
  EXPECT_FALSE(own->alike);
  for (std::size_t j = 0; j < 2; ++j) EXPECT_EQ(one->lag[j].value, own->lag[j].value);
}

/// A lag of the mean is none of a file's: its sigma says so, and files are told apart by theirs.
TEST(TorqueLag, CountsThatFilesDiffer) {
  Arm arm;
  const double late_s[] = {0.012, -0.008, 0.002};
  std::vector<RobotRecording> recordings;
  for (unsigned f = 0; f < 3; ++f) recordings.push_back(arm.recording({.lag_s = {late_s[f], 0.004}}, 5 + f));
  const auto found = arm.found(recordings);
  ASSERT_TRUE(found) << found.error().message;
  const auto alike =
      arm.found({arm.recording({.lag_s = {0.002, 0.004}}, 5), arm.recording({.lag_s = {0.002, 0.004}}, 6),
                 arm.recording({.lag_s = {0.002, 0.004}}, 7)});
  ASSERT_TRUE(alike) << alike.error().message;
  EXPECT_GT(found->lag[0].sigma, 4 * alike->lag[0].sigma);
  EXPECT_GT(found->lag[0].sigma, 0.003);
  EXPECT_LT(spread_of(found->fit.lag_of_files, 0).chance(), 1e-6);
  for (const Index j : {0, 1}) EXPECT_GT(spread_of(alike->fit.lag_of_files, j).chance(), 1e-3) << "joint " << j;
  for (const FileLag& lag : found->fit.lag_of_files)
    if (lag.joint == 0) EXPECT_NEAR(lag.value_s, late_s[lag.file], 4 * lag.sigma_s + 0.001) << "file " << lag.file;
}

TEST(TorqueLag, OfATorqueWithoutMotionIsHeldAndNamed) {
  Arm arm;
  const auto found = arm.found({arm.recording({.lag_s = {0.003, 0}, .offset_only = 1}, 3)});
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_EQ(found->lag[1].status, Status::held);
  EXPECT_EQ(found->lag[1].value, 0);
  EXPECT_THAT(found->notes, testing::Contains(testing::HasSubstr("torque_elbow_nm")));
}

}  // namespace
}  // namespace tribotwin::twin::identification
