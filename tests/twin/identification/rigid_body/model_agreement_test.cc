// A recording against the model it is used with: what is told, and that rough masses are not.
#include <cmath>
#include <numbers>
#include <random>

#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/identification/rigid_body/model_agreement.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
using testing::AllOf, testing::ElementsAre, testing::HasSubstr, testing::IsEmpty;

struct Case {
  std::shared_ptr<const mujoco::Model> model;
  Regressor regressor;

  explicit Case(const std::string& name)
      : model(mujoco::load_file(std::string(TRIBOTWIN_SOURCE_DIR "/mjcf/") + name).value()),
        regressor(Regressor::create(model->get()).value()) {}

  /// A minute over half of every joint's range, with Coulomb and viscous friction of `friction` times the largest
  /// torque and noise; every inertial parameter is wrong by up to `rough`, and so is the weight of the last body.
  JointMotion motion(double rough, double friction, std::uint64_t seed) const {
    const mjModel* m = model->get();
    const Index n = regressor.joints(), count = 3000;
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> any(-1, 1);
    Regressor r = regressor;
    VectorXd phi = r.model_parameters();
    // Of a body all alike: its mass, not its shape.
    for (Index b = 0; 10 * b + 9 < phi.size() - n; ++b) phi.segment(10 * b, 10) *= 1 + rough * any(random);
    JointMotion out;
    for (auto* x : {&out.q, &out.qd, &out.qdd, &out.torque}) x->setZero(n, count);
    out.moving.setConstant(n, count, true);
    MatrixXd wave(n, 3);
    for (double& x : wave.reshaped()) x = any(random);
    std::normal_distribution<double> normal;
    for (Index i = 0; i < count; ++i) {
      const double t = 0.02 * static_cast<double>(i);
      for (Index j = 0; j < n; ++j) {
        const double low = m->jnt_limited[j] ? m->jnt_range[2 * j] : -2,
                     high = m->jnt_limited[j] ? m->jnt_range[2 * j + 1] : 2, w = 1 + 0.5 * wave(j, 0),
                     a = 0.25 * (high - low);
        out.q(j, i) = (low + high) / 2 + a * std::sin(w * t + 3 * wave(j, 1)) + 0.3 * a * std::sin(2.3 * w * t);
        out.qd(j, i) = a * w * std::cos(w * t + 3 * wave(j, 1)) + 0.69 * a * w * std::cos(2.3 * w * t);
        out.qdd(j, i) = -a * w * w * std::sin(w * t + 3 * wave(j, 1)) - 1.587 * a * w * w * std::sin(2.3 * w * t);
      }
      out.torque.col(i) = r.at(out.q.col(i), out.qd.col(i), out.qdd.col(i)) * phi;
    }
    out.direction = out.qd.cwiseSign();
    const VectorXd size = out.torque.rowwise().lpNorm<Eigen::Infinity>();
    for (Index i = 0; i < count; ++i)
      for (Index j = 0; j < n; ++j)
        out.torque(j, i) +=
            size(j) * (friction * (std::copysign(1, out.qd(j, i)) + 0.2 * out.qd(j, i)) + 0.02 * normal(random));
    return out;
  }
};

TEST(ModelAgreement, RoughMassesAndFrictionAreNoFinding) {
  for (const char* name : {"er3a_c60.xml", "irb6620.xml", "br609.xml", "xl330_pendulum.xml"}) {
    const Case robot(name);
    for (const double rough : {0.0, 0.4})
      for (const double friction : {0.0, 0.5})
        for (const std::uint64_t seed : {1, 2, 3})
          EXPECT_THAT(doubtful_gravity(robot.regressor, robot.motion(rough, friction, seed)).findings, IsEmpty())
              << name << rough << friction << seed;
  }
}

TEST(ModelAgreement, AnotherUnitIsToldByGravity) {
  const Case robot("er3a_c60.xml");
  for (const double factor : {1e-3, 0.1, 1000.0, -1.0}) {
    JointMotion motion = robot.motion(0.3, 0.3, 1);
    motion.torque.row(1) *= factor;
    const auto found = doubtful_gravity(robot.regressor, motion).findings;
    ASSERT_FALSE(found.empty()) << factor;
    EXPECT_THAT(found.front(), AllOf(HasSubstr("torque_joint2_nm"), HasSubstr("gravity"))) << factor;
  }
}

TEST(ModelAgreement, AnotherZeroIsToldByGravity) {
  for (const char* name : {"er3a_c60.xml", "irb6620.xml"}) {
    const Case robot(name);
    for (const int joint : {2, 3})
      for (const int quarters : {-1, 1, 2}) {
        JointMotion motion = robot.motion(0.2, 0.3, 2);
        motion.q.row(joint - 1).array() -= quarters * std::numbers::pi / 2;
        const auto found = doubtful_gravity(robot.regressor, motion).findings;
        ASSERT_EQ(found.size(), 1u) << name << joint << quarters;
        EXPECT_THAT(found[0], AllOf(HasSubstr(std::to_string(90 * quarters) + " degrees added to position_joint" +
                                              std::to_string(joint) + "_rad"),
                                    HasSubstr("--columns")))
            << name;
      }
  }
}

// Turned over in its second joint the robot has the same gravity but for its sign: neither is told from the other.
TEST(ModelAgreement, AllTorquesOfTheOtherSignAreNoZeroAlone) {
  for (const char* name : {"er3a_c60.xml", "irb6620.xml", "br609.xml", "xl330_pendulum.xml"}) {
    const Case robot(name);
    JointMotion motion = robot.motion(0.2, 0.3, 2);
    motion.torque *= -1;
    const auto [findings, opposite] = doubtful_gravity(robot.regressor, motion);
    EXPECT_TRUE(opposite) << name;
    EXPECT_THAT(findings, ElementsAre(AllOf(HasSubstr("with the other sign"), HasSubstr("robot hang")))) << name;
  }
}

TEST(ModelAgreement, SizesAreThoseOfTheActuator) {
  const Case robot("er3a_c60.xml");
  const JointMotion motion = robot.motion(0, 0.3, 1);
  std::vector<double> effort(6, motion.torque.row(1).cwiseAbs().maxCoeff());
  EXPECT_THAT(doubtful_sizes(robot.regressor, motion, effort), IsEmpty());
  EXPECT_THAT(doubtful_sizes(robot.regressor, motion, std::vector<double>(6, 0.0)), IsEmpty());
  for (const auto& [factor, says] : {std::pair{1e3, "mNm"}, {1e-4, "kNm"}}) {
    JointMotion other = motion;
    other.torque.row(1) *= factor;
    EXPECT_THAT(doubtful_sizes(robot.regressor, other, effort),
                ElementsAre(AllOf(HasSubstr("torque_joint2_nm"), HasSubstr(says))));
  }
}

}  // namespace
}  // namespace tribotwin::twin::identification
