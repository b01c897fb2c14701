#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/identification/rigid_body/consistency.hpp>
#include <tribotwin/twin/identification/rigid_body/joint_friction.hpp>
#include <tribotwin/twin/numerics/filter.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/numerics/triangular_factor.hpp>
#include <tribotwin/twin/robot/base_parameters.hpp>
#include <tribotwin/twin/robot/regressor.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

/// Largest difference between Y phi and mj_inverse over random states, relative to the largest torque of the state.
double worst_difference(const mjModel* given, int states) {
  mujoco::ModelPtr m(mj_copyModel(nullptr, given));
  mujoco::DataPtr d(mj_makeData(m.get()));
  m->opt.disableflags |= mjDSBL_LIMIT | mjDSBL_CONTACT | mjDSBL_EQUALITY;
  auto regressor = Regressor::create(m.get());
  EXPECT_TRUE(regressor) << regressor.error().message;
  const VectorXd phi = regressor->model_parameters();
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  VectorXd q(m->nv), qd(m->nv), qdd(m->nv);
  double worst = 0;
  for (int s = 0; s < states; ++s) {
    for (int j = 0; j < m->nv; ++j)
      d->qpos[j] = q(j) = 2 * normal(random), d->qvel[j] = qd(j) = 3 * normal(random),
      d->qacc[j] = qdd(j) = 10 * normal(random);
    mj_inverse(m.get(), d.get());
    // Springs, dampers and friction are taken back: drives need the friction rows enabled, and what switches springs
    // off has other names in every engine.
    const VectorXd tau = Eigen::Map<const VectorXd>(d->qfrc_inverse, m->nv) +
                         Eigen::Map<const VectorXd>(d->qfrc_passive, m->nv) +
                         Eigen::Map<const VectorXd>(d->qfrc_constraint, m->nv);
    worst = std::max(worst, (regressor->at(q, qd, qdd) * phi - tau).cwiseAbs().maxCoeff() / tau.cwiseAbs().maxCoeff());
  }
  return worst;
}

bool hinges_and_slides(const mjModel* m) {
  if (m->njnt == 0) return false;
  for (int j = 0; j < m->njnt; ++j)
    if (m->jnt_type[j] != mjJNT_HINGE && m->jnt_type[j] != mjJNT_SLIDE) return false;
  return true;
}

void expect_base_is_the_rank(const mjModel* m) {
  auto regressor = Regressor::create(m);
  ASSERT_TRUE(regressor) << regressor.error().message;
  const BaseParameters base = base_parameters(*regressor);
  // By singular values of the regressor at states of its own.
  std::mt19937_64 random(11);
  std::normal_distribution<double> normal;
  const Index n = regressor->joints(), columns = static_cast<Index>(regressor->columns().size()),
              states = 20 + 3 * columns / n;
  MatrixXd W(states * n, columns);
  VectorXd q(n), qd(n), qdd(n);
  for (Index s = 0; s < states; ++s) {
    for (Index j = 0; j < n; ++j) q(j) = normal(random), qd(j) = normal(random), qdd(j) = 3 * normal(random);
    W.middleRows(s * n, n) = regressor->at(q, qd, qdd);
  }
  const VectorXd phi = regressor->model_parameters();
  EXPECT_LT((W(Eigen::all, base.independent) * (base.from_all * phi) - W * phi).norm(), 1e-9 * (W * phi).norm());
  const double longest = W.colwise().norm().maxCoeff();
  for (Index c = 0; c < columns; ++c) {
    const double length = W.col(c).norm();
    W.col(c) *= length > 1e-12 * longest ? 1 / length : 0;
  }
  const VectorXd sizes = singular_values(W);
  const Index rank = (sizes.array() > 1e-9 * sizes(0)).count();
  EXPECT_EQ(base.size(), rank);
  EXPECT_EQ(base.numerical_rank, rank);
}

TEST(Regressor, IsInverseDynamicsOfEveryShippedRobot) {
  int robots = 0;
  for (const auto& file : fs::directory_iterator(TRIBOTWIN_SOURCE_DIR "/mjcf")) {
    if (file.path().extension() != ".xml" || file.path().filename() == "scene.xml") continue;
    SCOPED_TRACE(file.path().filename());
    const auto model = mujoco::load_file(file.path());
    ASSERT_TRUE(model) << model.error().message;
    EXPECT_LT(worst_difference(model->get()->get(), 1000), 1e-10);
    expect_base_is_the_rank(model->get()->get());
    ++robots;
  }
  EXPECT_GE(robots, 6);
}

// Those that come with MuJoCo, where they are installed: arms, linkages, nets of slides. By day those of more than 30
// joints, whose regressors are large, in 50 states instead of 1,000.
TEST(Regressor, IsInverseDynamicsOfModelsOfOtherPeople) {
  const fs::path folder = "/usr/share/mujoco/model";
  ASSERT_TRUE(fs::exists(folder)) << "libmujoco-samples is not installed (twin/install-packages.sh --tests)";
  std::vector<fs::path> files;
  for (const auto& file : fs::recursive_directory_iterator(folder))
    if (file.path().extension() == ".xml") files.push_back(file.path());
  std::ranges::sort(files);
  std::vector<std::string> models;
  for (const auto& file : files) {
    char error[1000] = "";
    const mujoco::ModelPtr model(mj_loadXML(file.c_str(), nullptr, error, sizeof error));
    if (!model || !hinges_and_slides(model.get())) continue;
    SCOPED_TRACE(file);
    const bool often = model->nv <= 30 || std::getenv("TRIBOTWIN_NIGHTLY");
    EXPECT_LT(worst_difference(model.get(), often ? 1000 : 50), 1e-10);
    if (model->nv <= 30) expect_base_is_the_rank(model.get());
    models.push_back(file.filename());
  }
  RecordProperty("models", fmt::format("{}", models.size()));
  fmt::print("{} models:", models.size());
  for (const auto& m : models) fmt::print(" {}", m);
  fmt::print("\n");
  if (mj_version() < 300) EXPECT_GE(models.size(), 5u);  // later engines read only part of what came with 2.2.2
}

// Several joints in a body, anchors off the origin, slides that turn, a reference angle, rotors, a bystander welded on.
TEST(Regressor, IsInverseDynamicsOfATreeOfEverything) {
  const auto model = mujoco::load_string(R"(<mujoco><compiler angle="radian"/><option gravity="1 -2 -9"/><worldbody>
    <body pos=".1 .2 .3" euler=".3 -.2 .5"><joint type="hinge" axis="1 2 -1" pos=".1 0 .2" armature=".3"/>
       <joint type="slide" axis="0 1 1" pos=".2 .1 0" armature="2"/>
       <joint type="hinge" axis="0 -1 .3" pos="0 .2 .1" ref=".4"/>
      <geom type="box" size=".1 .2 .3" pos=".05 .02 .1" euler=".2 .3 .1"/>
      <body pos="0 .3 0"><geom size=".1"/><body pos=".3 0 0" euler="0 1 0"><joint type="slide" axis="1 0 .2" ref=".1"/>
       <joint type="hinge" axis="0 0 1" pos="-.1 0 0"/>
       <geom type="capsule" size=".05 .2" pos="0 .1 .2"/></body></body>
      <body pos="0 0 .4"><joint type="hinge" axis="1 0 0"/>
       <geom type="ellipsoid" size=".1 .05 .2" pos="0 0 .2"/></body></body>
    </worldbody></mujoco>)");
  ASSERT_TRUE(model) << model.error().message;
  EXPECT_LT(worst_difference((*model)->get(), 1000), 1e-10);
  expect_base_is_the_rank((*model)->get());
}

TEST(Regressor, RefusesOtherJoints) {
  const auto model = mujoco::load_string(
      "<mujoco><worldbody><body><freejoint name='loose'/><geom size='.1'/></body></worldbody></mujoco>");
  const auto regressor = Regressor::create((*model)->get());
  ASSERT_FALSE(regressor);
  EXPECT_THAT(regressor.error().message, testing::HasSubstr("'loose' is a free joint"));
}

// A double pendulum in the plane, by hand: two inertias with what they carry, two moments; m1 and my's that never act
// are in none.
TEST(BaseParameters, OfADoublePendulumAreThoseOfTextbooks) {
  const auto model = mujoco::load_string(
      R"(<mujoco><worldbody><body name="a"><joint name="j1" axis="0 1 0" armature=".1"/>
     <geom type="capsule" size=".02" fromto="0 0 0 .5 0 0"/>
    <body name="b" pos=".5 0 0"><joint name="j2" axis="0 1 0" armature=".2"/>
     <geom type="capsule" size=".02" fromto="0 0 0 .4 0 0"/></body></body></worldbody></mujoco>)");
  const BaseParameters base = base_parameters(*Regressor::create((*model)->get()));
  std::vector<std::string> groups;
  for (const auto& p : base.parameters) groups.push_back(p.group);
  EXPECT_THAT(groups, testing::ElementsAre("a.Iyy + 0.25 b.m + j1.Ia", "a.mx + 0.5 b.m", "a.mz", "b.Iyy", "b.mx",
                                           "b.mz", "j2.Ia"));
}

// A robot whose first axis is vertical and whose next two are parallel, with angles in as many digits.
BaseParameters of_an_arm_with(const std::string& right_angle, const std::string& half_turn) {
  const auto model = mujoco::load_string(fmt::format(
      R"(<mujoco><compiler angle="radian"/><worldbody>
     <body name="a" euler="{1} 0 0"><joint name="j1" axis="0 0 1"/><geom size=".1" pos=".02 .03 .1" mass="9"/>
     <body name="b" pos=".1 .02 -.4" euler="{0} 0 0"><joint name="j2" axis="0 0 1"/><geom size=".1" pos=".3 .1 .2"/>
     <body name="c" pos=".6 0 .1" euler="0 0 {0}"><joint name="j3" axis="0 0 1"/><geom size=".1" pos=".2 .1 .1"/>
     <body name="d" pos=".05 0 .1" euler="-{0} 0 0"><joint name="j4" axis="0 0 1"/><geom size=".1" pos="0 0 .2"/>
     </body></body></body></body></worldbody></mujoco>)",
      right_angle, half_turn));
  return base_parameters(*Regressor::create((*model)->get()));
}

TEST(BaseParameters, OfAnglesInFewDigitsAreThoseOfRightAngles) {
  const BaseParameters exact = of_an_arm_with("1.5707963267948966", "3.141592653589793");
  const double few = 1e-4;  // far above what five digits make of a metre, far below the numbers of the arm
  for (const auto& [right, half] :
       {std::pair{"1.5708", "3.1416"}, {"1.570796", "3.141593"}, {"1.57079633", "3.14159265"}}) {
    const BaseParameters rounded = of_an_arm_with(right, half);
    EXPECT_EQ(rounded.independent, exact.independent) << right;
    ASSERT_EQ(rounded.from_all.rows(), exact.from_all.rows()) << right;
    EXPECT_LT((rounded.from_all - exact.from_all).cwiseAbs().maxCoeff(), few) << right;
  }
}

TEST(TriangularFactor, IsThatOfTheWholeMatrixHoweverItComes) {
  const MatrixXd A = MatrixXd::Random(3001, 7);
  TriangularFactor whole(7), part(7);
  whole.add(A.topRows(2000));
  part.add(A.bottomRows(1001));
  whole.add(part);
  EXPECT_LT((whole.R().transpose() * whole.R() - A.transpose() * A).norm(), 1e-12 * (A.transpose() * A).norm());
  EXPECT_TRUE(whole.R().isUpperTriangular(0));
}

// Amplitude of a sine through 1 / (1 + (tan(pi f / fs) / tan(pi fc / fs))^8), no phase; a line passes unchanged.
TEST(Filter, IsAButterworthWithoutPhase) {
  std::vector<double> sine, line;
  for (int i = 0; i < 4000; ++i) sine.push_back(std::sin(2 * M_PI * 15 * i / 1000.0)), line.push_back(3 + 0.01 * i);
  const auto y = identification::low_passed(sine, 1000, 20);
  const double gain = 1 / (1 + std::pow(std::tan(M_PI * 0.015) / std::tan(M_PI * 0.02), 8));
  for (int i = 1000; i < 3000; ++i)
    ASSERT_NEAR(y[static_cast<std::size_t>(i)], gain * sine[static_cast<std::size_t>(i)], 1e-6);
  const auto straight = identification::low_passed(line, 1000, 20);
  for (std::size_t i = 0; i < line.size(); ++i)
    ASSERT_NEAR(straight[i], line[i], i < 300 || i >= 3700 ? 1e-4 : 1e-9);  // a hundredth of a step at the ends
}

TEST(JointFriction, HasTheLawsValuesAndItsDerivatives) {
  for (const auto& info : friction::laws()) {
    const auto law = friction::published_law(info.name);
    if (!law) continue;
    SCOPED_TRACE(info.name);
    const identification::JointFriction joint(info, {.speed = 100, .torque = 50, .torque_max_nm = 50});
    std::vector<double> p(law->values().begin(), law->values().end()), by(p.size());
    for (const double v : {-2.0, -0.1, 0.4, 1.7}) {
      const double value = joint.torque(p, v, 20, 50, by.data());
      EXPECT_NEAR(value, 50 * friction::torque(*law, 100 * v, 0.4, 50), 1e-12 * std::abs(value));
      for (std::size_t k = 0; k < p.size(); ++k) {
        const double h = 1e-6 * std::max(1e-3, std::abs(p[k]));
        auto up = p, down = p;
        up[k] += h, down[k] -= h;
        EXPECT_NEAR(by[k], (joint.torque(up, v, 20, 50) - joint.torque(down, v, 20, 50)) / (2 * h),
                    1e-5 * (std::abs(by[k]) + std::abs(value)))
            << info.parameters[k].name;
      }
    }
  }
}

// While the filtered direction turns: what friction is at standstill goes with it, what grows with the speed does not.
TEST(JointFriction, OfAFilteredMotionHasItsDerivatives) {
  for (const auto& info : friction::laws()) {
    const auto law = friction::published_law(info.name);
    if (!law) continue;
    SCOPED_TRACE(info.name);
    const identification::JointFriction joint(info, {.speed = 100, .torque = 50, .torque_max_nm = 50},
                                              {.offset = true, .asymmetry = true});
    std::vector<double> p(law->values().begin(), law->values().end());
    p.insert(p.end(), {3, 0.2});
    std::vector<double> by(p.size());
    for (const double direction : {-1.1, -0.3, 0.6}) {
      const auto at = [&](const std::vector<double>& q) { return joint.filtered_torque(q, -0.4, direction, 20, 50); };
      const double value = joint.filtered_torque(p, -0.4, direction, 20, 50, by.data());
      for (std::size_t k = 0; k < p.size(); ++k) {
        const double h = 1e-6 * std::max(1e-3, std::abs(p[k]));
        auto up = p, down = p;
        up[k] += h, down[k] -= h;
        EXPECT_NEAR(by[k], (at(up) - at(down)) / (2 * h), 1e-5 * (std::abs(by[k]) + std::abs(value)))
            << (k < info.parameters.size() ? info.parameters[k].name : "beside the law");
      }
    }
  }
  const identification::JointFriction linear(identification::coulomb_viscous(), {}, {.asymmetry = true});
  const double p[] = {4, 2, 0.1};
  EXPECT_NEAR(linear.filtered_torque(p, -0.5, -0.7, 0, 20), 4 * -0.7 + 2 * -0.5 + 0.1 * (4 + 2 * 0.5), 1e-12);
}

TEST(Consistency, ABodysOwnParametersArePossibleAndANegativeMassIsNot) {
  const auto model = mujoco::load_file(TRIBOTWIN_SOURCE_DIR "/mjcf/er3a_c60.xml");
  const auto regressor = *Regressor::create((*model)->get());
  const BaseParameters base = base_parameters(regressor);
  const VectorXd beta = base.from_all * regressor.model_parameters();
  const MatrixXd information = 1e6 * MatrixXd::Identity(beta.size(), beta.size());
  EXPECT_LT(identification::nearest_consistent(regressor, base, beta, information).distance_sigma, 0.1);
  VectorXd impossible = beta;
  const auto rotor =
      std::ranges::find(base.parameters, "joint4.Ia", &BaseParameters::Parameter::name) - base.parameters.begin();
  impossible(rotor) = -0.02;
  const auto nearest = identification::nearest_consistent(regressor, base, impossible, information);
  EXPECT_FALSE(nearest.possible);
  EXPECT_GT(nearest.base(rotor), -1e-3);  // other parameters may give way a little, the rotor's sign may not stay
  EXPECT_GE(nearest.parameters.tail(6).minCoeff(), 0);
}

}  // namespace
}  // namespace tribotwin::twin
