#include <cmath>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/identification/verdict/joint_verdict.hpp>
#include <tribotwin/twin/identification/verdict/report.hpp>

/// Residuals of one joint that are known: noise, and what a model may lack.
namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd;
using testing::ElementsAre, testing::HasSubstr, testing::IsEmpty, testing::Not, testing::SizeIs;

struct Lacks {
  const char* on;  ///< what the residual depends on; empty: nothing
  double stribeck_nm = 0, per_load = 0, ripple_nm = 0, drift_nm = 0;
  double noise_nm = 1, memory = 0;  ///< correlation of the noise from sample to sample
  const char* says = "";
};

const Regressor& pendulum() {
  static const auto model = mujoco::load_string(
      R"(<mujoco><worldbody><body><joint name="elbow" axis="0 1 0"/><geom size=".1" pos=".3 0 0" mass="3"/></body>
      </worldbody></mujoco>)");
  static const Regressor regressor = *Regressor::create((*model)->get());
  return regressor;
}

struct Recorded {
  JointMotion motion;
  MatrixXd predicted, load;
};

/// A minute and a half of three sines, 100 Hz, cut-off 20 Hz; at rest below 0.05 rad/s.
Recorded recorded(const Lacks& lacks, unsigned seed) {
  constexpr Index n = 9000;
  constexpr double rate_hz = 100;
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  Recorded r;
  for (MatrixXd* all : {&r.motion.q, &r.motion.qd, &r.motion.qdd, &r.motion.torque, &r.predicted, &r.load})
    *all = MatrixXd::Zero(1, n);
  r.motion.temperature_degC = MatrixXd::Constant(1, n, 20);
  r.motion.moving.setConstant(1, n, true);
  r.motion.segments = {{0, n}};
  r.motion.file = {0};
  r.motion.edge_s = {0};
  r.motion.cutoff_hz = 20, r.motion.period_s = 1 / rate_hz;
  double noise = 0;
  for (Index i = 0; i < n; ++i) {
    const double t = static_cast<double>(i) / rate_hz;
    r.motion.time_s.push_back(t);
    for (int k = 0; k < 3; ++k) {
      const double w = 2 * M_PI * (0.173 + 0.131 * k), a = 0.9 / (1 + k);
      r.motion.q(0, i) += a * std::sin(w * t + k + 0.1 * seed),
          r.motion.qd(0, i) += a * w * std::cos(w * t + k + 0.1 * seed);
    }
    const double q = r.motion.q(0, i), qd = r.motion.qd(0, i), sign = qd < 0 ? -1 : 1;
    r.motion.moving(0, i) = std::abs(qd) > 0.05;
    r.load(0, i) = 10 * std::cos(q);
    r.predicted(0, i) = r.load(0, i) + 4 * sign;
    noise = lacks.memory * noise + std::sqrt(1 - lacks.memory * lacks.memory) * lacks.noise_nm * normal(random);
    r.motion.torque(0, i) = r.predicted(0, i) + noise + sign * lacks.stribeck_nm * std::exp(-std::abs(qd) / 0.3) +
                            sign * lacks.per_load * (std::abs(r.load(0, i)) - 5) + lacks.ripple_nm * std::sin(9 * q) +
                            lacks.drift_nm * (t / 90 - 0.5);
  }
  return r;
}

JointVerdict judged(const Lacks& lacks, unsigned seed) {
  const Recorded r = recorded(lacks, seed);
  return judge_joints(pendulum(), r.motion, r.predicted, r.load).front();
}

const Dependence* largest(const JointVerdict& v) {
  const Dependence* found = nullptr;
  for (const Dependence& d : v.dependence)
    if (d.shown() && (!found || d.share > found->share)) found = &d;
  return found;
}

TEST(JointVerdict, NamesWhatTheResidualDependsOn) {
  const std::vector<Lacks> cases{{.on = "speed", .stribeck_nm = 6, .says = "changes with speed"},
                                 {.on = "load", .per_load = 1.0, .says = "grows with load"},
                                 {.on = "position", .ripple_nm = 3, .says = "repeats with position"},
                                 {.on = "time", .drift_nm = 12, .noise_nm = 3, .says = "drifts with time"}};
  for (const Lacks& c : cases)
    for (unsigned seed = 1; seed <= 3; ++seed) {
      SCOPED_TRACE(fmt::format("{} {}", c.on, seed));
      const JointVerdict v = judged(c, seed);
      const Dependence* d = largest(v);
      ASSERT_TRUE(d);
      EXPECT_EQ(d->on, c.on);
      if (d->on == "time") EXPECT_NEAR(d->bins.back().to, 90, 10);  // s
      EXPECT_GT(d->share, 0.3);
      EXPECT_LT(d->chance, 1e-6);
      EXPECT_GT(v.relative_error, 0.1);
    }
}

// Noise is a verdict too, also where it is correlated over a tenth of a second.
TEST(JointVerdict, NoiseDependsOnNothing) {
  for (const double memory : {0.0, 0.9}) {
    int alarms = 0;
    for (unsigned seed = 1; seed <= 20; ++seed)
      alarms += largest(judged({.on = "", .memory = memory}, seed)) != nullptr;
    EXPECT_EQ(alarms, 0) << memory;
  }
}

TEST(JointVerdict, OctavesAddUpAndTellSlowFromFast) {
  const JointVerdict white = judged({.on = ""}, 1), slow = judged({.on = "", .memory = 0.99}, 1);
  for (const auto* v : {&white, &slow}) {
    double sum = 0;
    for (const Octave& o : v->octaves) sum += o.share;
    EXPECT_NEAR(sum, 1, 1e-9);
  }
  EXPECT_NEAR(white.half_below_hz, 25, 5);  // half of the band of 100 Hz: nothing was filtered here
  EXPECT_LT(slow.half_below_hz, 2);
  EXPECT_EQ(white.white_half_hz, 10);
}

TEST(JointVerdict, ABadlyExplainedJointIsWarnedOf) {
  const Lacks bad{.on = "load", .per_load = 1.5, .noise_nm = 0.3}, good{.on = "", .noise_nm = 0.3};
  const std::vector<JointVerdict> all{judged(bad, 1), judged(good, 1)};
  EXPECT_TRUE(all[0].badly_explained());
  EXPECT_THAT(badly_explained(all), ElementsAre("elbow"));
  const auto warnings = warnings_of(all);
  ASSERT_THAT(warnings, SizeIs(1));
  EXPECT_THAT(warnings[0], HasSubstr("joint elbow: "));
  EXPECT_THAT(warnings[0], HasSubstr("% of its torque's variation is unexplained; the residual grows with load ("));
  EXPECT_THAT(warnings[0], HasSubstr("a law with load would help"));
  const auto j = json_of(all[0]);
  EXPECT_TRUE(j["badly_explained"]);
  EXPECT_GT(j["dependence"]["load"]["share"], 0.5);
  EXPECT_THAT(j["dependence"]["load"]["bins"], Not(IsEmpty()));
  EXPECT_THAT(table_of(all), HasSubstr("by load"));
}

// TX40's wrist: the torque of one motor carries friction of another joint.
TEST(JointVerdict, NamesTheJointWhoseMotionABadResidualFollows) {
  static const auto model = mujoco::load_string(
      R"(<mujoco><worldbody><body><joint name="bend" axis="0 1 0"/><geom size=".1" pos=".3 0 0" mass="3"/>
      <body><joint name="roll" axis="1 0 0"/><geom size=".1" pos=".1 .1 0" mass="1"/></body></body>
      </worldbody></mujoco>)");
  const Regressor regressor = *Regressor::create((*model)->get());
  Recorded one = recorded({.on = "", .noise_nm = 0.5}, 1), other = recorded({.on = "", .noise_nm = 0.5}, 17);
  const auto stacked = [](const MatrixXd& a, const MatrixXd& b) {
    MatrixXd both(2, a.cols());
    both << a, b;
    return both;
  };
  Recorded r = one;
  for (const auto member :
       {&JointMotion::q, &JointMotion::qd, &JointMotion::qdd, &JointMotion::torque, &JointMotion::temperature_degC})
    r.motion.*member = stacked(one.motion.*member, other.motion.*member);
  r.motion.moving.resize(2, one.motion.size());
  r.motion.moving << one.motion.moving, other.motion.moving;
  r.predicted = stacked(one.predicted, other.predicted), r.load = stacked(one.load, other.load);
  for (Index i = 0; i < r.motion.size(); ++i) r.motion.torque(0, i) += r.motion.qd(1, i) < 0 ? -4 : 4;
  const auto all = judge_joints(regressor, r.motion, r.predicted, r.load);
  ASSERT_TRUE(all[0].badly_explained());
  EXPECT_EQ(largest(all[0])->on, "speed of roll");
  EXPECT_THAT(warnings_of(all).at(0), HasSubstr("changes with the speed of roll ("));
}

TEST(JointVerdict, AJointThatHardlyMovesHasNone) {
  Recorded r = recorded({.on = ""}, 1);
  r.motion.moving.setConstant(false);
  const auto v = judge_joints(pendulum(), r.motion, r.predicted, r.load).front();
  EXPECT_EQ(v.samples, 0);
  EXPECT_FALSE(v.badly_explained());
  EXPECT_TRUE(json_of(v)["relative_error"].is_null());
}

}  // namespace
}  // namespace tribotwin::twin::identification
