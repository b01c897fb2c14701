#include <cmath>

#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/identification/rigid_body/training_range.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd;
using testing::AllOf, testing::HasSubstr;

/// One joint, 1000 samples of sines; of the first tenth it rests.
JointMotion motion_of(double position_rad, double speed_rad_s, double acceleration_rad_s2, double degC) {
  constexpr Index n = 1000;
  JointMotion m;
  for (MatrixXd* all : {&m.q, &m.qd, &m.qdd, &m.temperature_degC}) all->resize(1, n);
  m.moving.setConstant(1, n, true);
  m.moving.leftCols(n / 10).setConstant(false);
  for (Index i = 0; i < n; ++i) {
    const double x = 0.1 * static_cast<double>(i);
    m.q(0, i) = position_rad * std::sin(x), m.qd(0, i) = speed_rad_s * std::cos(x),
           m.qdd(0, i) = acceleration_rad_s2 * std::sin(x);
  }
  m.temperature_degC.setConstant(degC);
  return m;
}

MatrixXd load_of(const JointMotion& m, double most_nm) { return most_nm / m.q.cwiseAbs().maxCoeff() * m.q; }

struct Case {
  const char* name;
  double position, speed, acceleration, load, degC;
  bool with_temperature = true;
  const char* says = "";
};

class TrainingRange : public testing::TestWithParam<Case> {};

TEST_P(TrainingRange, IsLeftWhereItIsLeft) {
  const Case& c = GetParam();
  const JointMotion trained = motion_of(1, 2, 10, 30), asked = motion_of(c.position, c.speed, c.acceleration, c.degC);
  const auto ranges = ranges_of(trained, load_of(trained, 20), true);
  const auto found = beyond(ranges, asked, load_of(asked, c.load), c.with_temperature);
  const std::string line = beyond_training("elbow", false, found[0]);
  EXPECT_EQ(line.empty(), !*c.says) << line;
  EXPECT_THAT(line, HasSubstr(c.says));
  EXPECT_EQ(found[0].size(), c.with_temperature ? 5u : 4u);
}

INSTANTIATE_TEST_SUITE_P(Motion, TrainingRange,
                         testing::Values(Case{"Same", 1, 2, 10, 20, 30}, Case{"Smaller", 0.2, 0.3, 1, 1, 30},
                                         Case{"ALittleMore", 1.15, 2.3, 11.5, 21.9, 31.9},
                                         Case{"Speed", 1, 3, 10, 20, 30, true,
                                              "joint elbow leaves the training: speed reaches 3 rad/s (-2 .. 2 in "},
                                         Case{"Position", -2, 2, 10, 20, 30, true, "position reaches"},
                                         Case{"Acceleration", 1, 2, 30, 20, 30, true, "acceleration reaches"},
                                         Case{"Load", 1, 2, 10, 40, 30, true, "load reaches 40 Nm ("},
                                         Case{"Hot", 1, 2, 10, 20, 45, true,
                                              "temperature reaches 45 degC (30 .. 30 in training; 1e+02 % of samples"},
                                         Case{"TemperatureNotKnown", 1, 2, 10, 20, 45, false}),
                         [](const auto& info) { return info.param.name; });

// cos(x) is above 2.4/3 in arccos(0.8)/pi of the time, and as often below -2.4/3.
TEST(TrainingRange, CountsTheShareOutside) {
  const JointMotion trained = motion_of(1, 2, 10, 30), asked = motion_of(1, 3, 10, 30);
  const auto found = beyond(ranges_of(trained, load_of(trained, 20), false), asked, load_of(asked, 20), false);
  EXPECT_NEAR(found[0][1].share, 2 * std::acos(0.8) / M_PI, 0.01);
  EXPECT_NEAR(std::abs(found[0][1].furthest), 3, 0.01);
  EXPECT_EQ(found[0][0].share, 0);
}

TEST(TrainingRange, CountsSamplesInTheTraining) {
  const JointMotion trained = motion_of(1, 2, 10, 30), asked = motion_of(1, 3, 10, 30);
  const auto ranges = ranges_of(trained, load_of(trained, 20), false);
  const auto counts = [&](const JointMotion& m, double most_nm) {
    return in_training(ranges, m, load_of(m, most_nm), false);
  };
  EXPECT_EQ(counts(trained, 20), trained.moving);
  EXPECT_EQ(counts(trained, 1), trained.moving);  // less load is no strain
  const auto in = counts(asked, 20);
  for (Index i = 0; i < asked.size(); ++i)
    ASSERT_EQ(in(0, i), asked.moving(0, i) && std::abs(asked.qd(0, i)) <= 2.4) << i;
  EXPECT_FALSE(in_training({}, trained, load_of(trained, 20), false).any());
}

// Positions and accelerations act on all joints, speeds on their own.
TEST(TrainingRange, OtherJointsLeaveItToo) {
  const auto two = [](const JointMotion& first, const JointMotion& second) {
    JointMotion m = first;
    for (MatrixXd JointMotion::*all :
         {&JointMotion::q, &JointMotion::qd, &JointMotion::qdd, &JointMotion::temperature_degC}) {
      (m.*all).conservativeResize(2, Eigen::NoChange);
      (m.*all).row(1) = (second.*all).row(0);
    }
    m.moving = first.moving.replicate(2, 1);
    return m;
  };
  const JointMotion as_trained = motion_of(1, 2, 10, 30);
  const JointMotion trained = two(as_trained, as_trained);
  const MatrixXd load = MatrixXd::Constant(2, trained.size(), 5);
  const auto ranges = ranges_of(trained, load, false);
  const auto faster = in_training(ranges, two(as_trained, motion_of(1, 3, 10, 30)), load, false),
             harder = in_training(ranges, two(as_trained, motion_of(1, 2, 15, 30)), load, false);
  EXPECT_EQ(faster.row(0), trained.moving.row(0));
  EXPECT_LT(faster.row(1).count(), trained.moving.row(1).count());
  EXPECT_EQ(harder.row(0), harder.row(1));
  EXPECT_LT(harder.row(0).count(), trained.moving.row(0).count());
}

// The margin is for bands, not for proof; and a joint that rests is not faster than one that always turned one way.
TEST(TrainingRange, MotionIsInItsSpanWithoutAMargin) {
  const JointMotion trained = motion_of(1, 2, 10, 30), further = motion_of(1.05, 2, 10, 30);
  auto ranges = ranges_of(trained, load_of(trained, 20), false);
  EXPECT_TRUE(motion_in_span(ranges, trained).rightCols(900).all());
  const auto in = motion_in_span(ranges, further);
  for (Index i = 100; i < further.size(); ++i)
    ASSERT_EQ(in(0, i), ranges[0][0].low <= further.q(0, i) && further.q(0, i) <= ranges[0][0].high) << i;
  EXPECT_LT(in.count(), 900);
  JointMotion resting = trained;
  resting.qd.setZero();
  ranges[0][static_cast<std::size_t>(Ranged::speed)] = {0.5, 2};
  EXPECT_TRUE(motion_in_span(ranges, resting).rightCols(900).all());
  EXPECT_FALSE(motion_in_span({}, trained).any());
}

TEST(TrainingRange, JointsOfOneChainLoadEachOther) {
  const auto model = *mujoco::load_string(R"(<mujoco><worldbody>
    <body><joint name="waist" axis="0 0 1"/><geom size=".1" pos=".1 0 0" mass="3"/>
      <body><joint name="left" axis="0 1 0"/><geom size=".1" pos=".3 0 0" mass="1"/>
        <body pos=".3 0 0"><joint name="hand" axis="0 1 0"/><geom size=".1" pos=".1 0 0" mass="1"/></body></body>
      <body><joint name="right" axis="0 1 0"/><geom size=".1" pos="-.3 0 0" mass="1"/></body>
    </body></worldbody></mujoco>)");
  const Regressor regressor = *Regressor::create(model->get());
  const Index waist = 0, left = 1, hand = 2, right = 3;
  for (const Index j : {waist, left, hand, right}) {
    EXPECT_TRUE(loads(regressor, j, waist)) << j;
    EXPECT_TRUE(loads(regressor, waist, j)) << j;
    EXPECT_TRUE(loads(regressor, j, j)) << j;
  }
  EXPECT_TRUE(loads(regressor, hand, left));
  EXPECT_TRUE(loads(regressor, left, hand));
  EXPECT_FALSE(loads(regressor, right, hand));
  EXPECT_FALSE(loads(regressor, left, right));
}

TEST(TrainingRange, OfAJointAtRestHasNoSpeed) {
  JointMotion m = motion_of(1, 2, 10, 30);
  m.moving.setConstant(false);
  const auto ranges = ranges_of(m, load_of(m, 20), true);
  for (const Span& span : ranges[0]) EXPECT_FALSE(span.known());
}

}  // namespace
}  // namespace tribotwin::twin::identification
