#include <cmath>
#include <random>

#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/tests/twin/identification/multisine.hpp>
#include <tribotwin/twin/identification/identifiability.hpp>
#include <tribotwin/twin/identification/verdict/friction_lacking.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index;

/// A hinge without gravity, with torque by position, that swings over so much of its range.
class Hinge {
 public:
  std::vector<Lacking> lacking(double amplitude_rad) const {
    std::mt19937_64 random(3);
    std::normal_distribution<double> normal;
    const Multisine swing(1, random, {.amplitude_rad = amplitude_rad});
    RobotRecording r{.file = "hinge.csv"};
    constexpr Index samples = 2500;
    r.position.resize(1, samples), r.torque.resize(1, samples);
    for (Index i = 0; i < samples; ++i) {
      const double t = static_cast<double>(i) / 125;
      const auto [q, qd, qdd] = swing.at(t);
      r.time_s.push_back(t);
      r.position(0, i) = q(0);
      r.torque(0, i) = 0.3 * qdd(0) + std::copysign(2, qd(0)) + 1.5 * qd(0) + 0.4 + 3 * std::cos(q(0)) -
                       0.02 * std::sin(q(0)) + 0.1 * normal(random);
    }
    const auto motion = prepare({&r, 1}, regressor_, {});
    RobotFriction friction = *robot_friction(*model_, regressor_, coulomb_viscous());
    friction[0].depend_on_position();
    const auto fit = fit_dynamics(regressor_, base_, friction, *motion);
    EXPECT_TRUE(fit) << fit.error().message;
    return lacking_friction(regressor_, friction, *motion,
                            gear_load(regressor_, base_, fit->parameters.base, *motion, 1), *fit);
  }

 private:
  std::shared_ptr<const mujoco::Model> model_ = *mujoco::load_string(R"(<mujoco><worldbody><body>
    <joint name="hinge" axis="0 0 1"/><geom size=".1" pos=".3 0 0" mass="3"/></body></worldbody></mujoco>)");
  Regressor regressor_ = *Regressor::create(model_->get());
  BaseParameters base_ = base_parameters(regressor_);
};

// sin_q is small beside its interval, but known to a hundredth of the torque by position: its phase is.
TEST(FrictionLacking, TorqueByPositionIsANumberWhereTheJointTurnsFarEnough) {
  EXPECT_THAT(withheld(Hinge().lacking(0.8)), testing::IsEmpty());
}

// Within so little of the range its cosine is an offset.
TEST(FrictionLacking, TorqueByPositionIsNamedWhereTheJointHardlyTurns) {
  const auto all = Hinge().lacking(0.03);
  EXPECT_THAT(withheld(all), testing::Contains("hinge.cos_q"));
  const auto cosine = std::ranges::find(all, "hinge.cos_q", &Lacking::parameter);
  ASSERT_NE(cosine, all.end());
  EXPECT_THAT(sentence(*cosine), testing::HasSubstr("record more of the joint's range"));
}

}  // namespace
}  // namespace tribotwin::twin::identification
