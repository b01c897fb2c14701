#include <cmath>
#include <limits>
#include <memory>
#include <random>

#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/identification/experiment_design/experiment_design.hpp>

/// A robot of two joints without drives, whose next experiment is designed, recorded with noise and identified.
namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

constexpr auto arm_xml = R"(<mujoco><worldbody>
  <body name="upper"><joint name="shoulder" axis="0 1 0" limited="true" range="-120 120" armature=".4"/>
    <geom type="capsule" size=".05" fromto="0 0 0 .5 0 0" mass="6"/>
  <body name="fore" pos=".5 0 0"><joint name="elbow" axis="0 1 0" limited="true" range="-100 100" armature=".2"/>
    <geom type="capsule" size=".04" fromto="0 0 0 .4 0 0" mass="3"/></body></body>
  </worldbody></mujoco>)";

constexpr double rate_hz = 250, cutoff_hz = 20, noise_nm[] = {0.4, 0.1};
/// In the band of the filter.
double filtered_nm(int joint) { return noise_nm[joint] * std::sqrt(2 * cutoff_hz / rate_hz); }

/// The friction that a design assumed, per joint.
std::vector<std::vector<double>> assumed(const ExperimentDesign& d) {
  std::vector<std::vector<double>> out(2);
  for (const auto& p : d.parameters)
    if (p.rotor >= 0) out[static_cast<std::size_t>(p.rotor)].push_back(p.value);
  return out;
}

struct Arm {
  std::shared_ptr<const mujoco::Model> model = *mujoco::load_string(arm_xml);
  Regressor regressor = *Regressor::create(model->get());
  BaseParameters base = base_parameters(regressor);

  ExperimentDesign design(const friction::LawInfo& law, DesignInput input = {}) const {
    input.law = &law;
    if (input.noise.empty()) input.noise = {filtered_nm(0), filtered_nm(1)};
    auto out = design_experiment(*model, regressor, base, input, options);
    EXPECT_TRUE(out) << out.error().message;
    return std::move(*out);
  }

  /// What a controller records of a motion until a time, where friction is as the design assumed, `times` over.
  RobotRecording recorded(const ExperimentDesign& d, double until_s, double times = 1) {
    const auto parameters = assumed(d);
    const MotionStates s = d.motion.states(1 / rate_hz, until_s);
    RobotRecording r{.file = "recorded.csv", .position = s.q, .torque = MatrixXd(2, s.size())};
    std::mt19937_64 random(5);
    std::normal_distribution<double> normal;
    for (Index i = 0; i < s.size(); ++i) {
      r.time_s.push_back(static_cast<double>(i) / rate_hz);
      const VectorXd rigid = regressor.at(s.q.col(i), s.qd.col(i), s.qdd.col(i)) * regressor.model_parameters();
      r.torque.col(i) = rigid;
      for (Index j = 0; j < 2; ++j) {
        const auto at = static_cast<std::size_t>(j);
        if (s.qd(j, i) != 0)
          r.torque(j, i) +=
              times * d.friction[at].torque(parameters[at], s.qd(j, i), regressor.load(j, rigid, s.qdd.col(i)), 20);
        r.torque(j, i) += noise_nm[at] * normal(random);
      }
    }
    return r;
  }

  ExcitationOptions options{.period_s = 5, .harmonics = 3, .heating_s = 0, .evaluations = 200};
};

const friction::LawInfo& law(const char* name) { return **dynamics_law(name, "law"); }

class Design : public testing::TestWithParam<const char*> {};

TEST_P(Design, SigmasAreThoseOfTheFit) {
  Arm arm;
  const ExperimentDesign d = arm.design(law(GetParam()));
  const auto motion =
      prepare(std::vector{arm.recorded(d, d.motion.duration_s())}, arm.regressor, {.cutoff_hz = cutoff_hz});
  ASSERT_TRUE(motion) << motion.error().message;
  const auto fit = fit_dynamics(arm.regressor, arm.base, d.friction, *motion);
  ASSERT_TRUE(fit) << fit.error().message;
  for (Index c = 0; c < d.after.size(); ++c) {
    const DesignParameter& p = d.parameters[static_cast<std::size_t>(c)];
    double sigma = std::numeric_limits<double>::quiet_NaN();
    if (p.rotor < 0) sigma = fit->base[static_cast<std::size_t>(c)].sigma;
    for (const auto& e : p.rotor < 0 ? std::vector<Estimate>{} : fit->friction[static_cast<std::size_t>(p.rotor)])
      if (p.name.ends_with("." + e.name)) sigma = e.sigma;
    EXPECT_GT(sigma, 0.5 * d.after(c) * p.scale) << p.name;
    EXPECT_LT(sigma, 2 * d.after(c) * p.scale) << p.name;
    EXPECT_GT(d.before(c), 100) << p.name;
  }
}

INSTANTIATE_TEST_SUITE_P(Laws, Design, testing::Values("coulomb_viscous", "stribeck"),
                         [](const auto& info) { return info.param; });

/// Geometric mean of the sigmas of friction.
double friction_sigma(const ExperimentDesign& d, const VectorXd& sigmas) {
  double sum = 0, count = 0;
  for (Index c = 0; c < sigmas.size(); ++c)
    if (d.parameters[static_cast<std::size_t>(c)].rotor >= 0) sum += std::log(sigmas(c)), ++count;
  return std::exp(sum / count);
}

TEST(Design, TellsFrictionBetterThanAMotionForInertiaOfTheSameLength) {
  Arm arm;
  const ExperimentDesign d = arm.design(law("stribeck"));
  const auto plain = excite(*arm.model, arm.regressor, arm.base, arm.options);
  ASSERT_TRUE(plain);
  EXPECT_LE(d.motion.duration_s(), plain->duration_s() + 1e-9);
  const DynamicsInformation information(
      arm.regressor, arm.base, d.friction,
      {.parameters = {.base = arm.base.from_all * arm.regressor.model_parameters(), .friction = assumed(d)},
       .noise = Eigen::Vector2d(filtered_nm(0), filtered_nm(1)),
       .cutoff_hz = cutoff_hz,
       .speed = VectorXd::Constant(2, 1.6)});
  const VectorXd of_plain = information.sigmas(
      information.of(plain->states(0.05, plain->duration_s()), std::vector<VectorXd>{VectorXd::Constant(2, 20)}));
  EXPECT_LT(friction_sigma(d, d.after), 0.75 * friction_sigma(d, of_plain));
}

TEST(Design, AMotionInWhichNothingCountsTellsNothing) {
  Arm arm;
  const ExperimentDesign d = arm.design(law("coulomb_viscous"));
  const DynamicsInformation information(
      arm.regressor, arm.base, d.friction,
      {.parameters = {.base = arm.base.from_all * arm.regressor.model_parameters(), .friction = assumed(d)},
       .noise = Eigen::Vector2d(1, 1),
       .speed = VectorXd::Constant(2, 1.6)});
  MotionStates still{.step_s = 0.05, .q = MatrixXd::Zero(2, 10), .qd = MatrixXd::Zero(2, 10), .qdd = {}};
  still.qdd = still.qd;
  const std::vector<VectorXd> degC{VectorXd::Constant(2, 20)};
  EXPECT_EQ(information.of(still, degC).norm(), 0);
  still.qd.setConstant(1);
  EXPECT_GT(information.of(still, degC).norm(), 0);
  still.qd.col(5).setConstant(0.01);  // two periods of 20 Hz are two states
  MotionStates beside = still;
  for (auto* m : {&beside.q, &beside.qd, &beside.qdd}) *m = m->leftCols(3).eval();
  EXPECT_NEAR(information.of(still, degC).norm(), 5.0 / 3 * information.of(beside, degC).norm(), 1e-9);
}

TEST(Design, WhatRoundingLeftOfAParameterIsItsSizeInNoWay) {
  Arm arm;
  const ExperimentDesign d = arm.design(law("coulomb_viscous"));
  auto friction = assumed(d);
  const auto scale_of_viscous = [&](double value) {
    friction[1][1] = value;
    const DynamicsInformation information(
        arm.regressor, arm.base, d.friction,
        {.parameters = {.base = arm.base.from_all * arm.regressor.model_parameters(), .friction = friction},
         .noise = Eigen::Vector2d(1, 1),
         .speed = VectorXd::Constant(2, 1.6)});
    for (const auto& p : information.parameters())
      if (p.name == "elbow.Fv") return p.scale;
    return 0.0;
  };
  const double of_none = scale_of_viscous(0);
  EXPECT_GT(of_none, 0.001);
  EXPECT_NEAR(scale_of_viscous(1e-12), of_none, 1e-6 * of_none);
  EXPECT_EQ(scale_of_viscous(0.7), 0.7);
}

/// Numbers that a fit knows beside typical ones of the same law may be no friction together.
TEST(Design, LinearisesAboutFrictionThatIsPossible) {
  Arm arm;
  arm.options.evaluations = 20;
  constexpr double times = 3;  // what a robot has of what is typical
  const auto& extended = law("steady_state_extended");
  const ExperimentDesign first = arm.design(extended);
  const auto before = prepare(std::vector{arm.recorded(first, first.motion.duration_s(), times)}, arm.regressor,
                              {.cutoff_hz = cutoff_hz});
  ASSERT_TRUE(before);
  const ExperimentDesign next = arm.design(extended, {.noise = {{}, {}}, .recorded = &*before});
  const auto truth = assumed(first), about = assumed(next);
  for (std::size_t j = 0; j < 2; ++j) {
    double square = 0;
    for (const double speed : {0.1, 0.4, 1.0}) {
      const auto ratio = [&](double degC) {
        return next.friction[j].torque(about[j], speed, 0, degC) /
               (times * first.friction[j].torque(truth[j], speed, 0, 20));
      };
      square += std::pow(ratio(20) - 1, 2) / 3;
      EXPECT_THAT(ratio(35), testing::AllOf(testing::Gt(0.2), testing::Lt(4))) << j << ", " << speed;
    }
    EXPECT_LT(std::sqrt(square), 0.3) << j;
  }
}

TEST(Design, FillsWhatRecordingsLack) {
  Arm arm;
  const ExperimentDesign first = arm.design(law("stribeck"));
  // A third of the first section alone: no slow passes.
  const auto before =
      prepare(std::vector{arm.recorded(first, first.motion.inertia_s / 3)}, arm.regressor, {.cutoff_hz = cutoff_hz});
  ASSERT_TRUE(before);
  const ExperimentDesign next = arm.design(law("stribeck"), {.noise = {{}, {}}, .recorded = &*before});
  int lacking = 0;
  for (Index c = 0; c < next.after.size(); ++c) {
    EXPECT_LT(next.after(c), next.before(c));
    EXPECT_TRUE(ExperimentDesign::is_told(next.after(c)) || next.parameters[static_cast<std::size_t>(c)].value == 0);
    lacking += !ExperimentDesign::is_told(next.before(c));
  }
  EXPECT_GE(lacking, 1);
  EXPECT_LT(friction_sigma(next, next.after), 0.4 * friction_sigma(next, next.before));
  for (int j : {0, 1}) EXPECT_NEAR(next.noise(j), filtered_nm(j), 0.4 * filtered_nm(j));
}

}  // namespace
}  // namespace tribotwin::twin::identification
