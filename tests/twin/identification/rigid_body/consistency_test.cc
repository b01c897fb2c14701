#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/tests/twin/identification/swing_recording.hpp>
#include <tribotwin/twin/identification/rigid_body/consistency.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics_file.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

/// Fits whose least-squares parameters may belong to no real bodies. The judge is the condition of a convex minimum: no
/// way to other real bodies goes down.
namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::Matrix4d, Eigen::MatrixXd, Eigen::VectorXd;

constexpr auto arm_xml = R"(<mujoco><worldbody>
  <body name="upper"><joint name="shoulder" axis="0 1 0" armature=".05"/>
    <geom type="capsule" size=".05" fromto="0 0 0 .4 0 0" mass="4"/>
  <body name="fore" pos=".4 0 0"><joint name="elbow" axis="{}" armature=".01"/>
    <geom type="box" size=".1 .04 .03" pos=".1 .01 0" mass="1"/></body></body></worldbody></mujoco>)";

struct Fitted {
  JointMotion motion;
  DynamicsFit fit;
  ConsistentDynamics consistent;
};

class Arm {
 public:
  explicit Arm(const char* elbow_axis = "0 0 1")
      : model_(*mujoco::load_string(fmt::format(fmt::runtime(arm_xml), elbow_axis))) {}

  const Regressor& regressor() const { return regressor_; }
  const BaseParameters& base() const { return base_; }
  const RobotFriction& friction() const { return friction_; }

  RobotRecording recording(unsigned seed, double noise_nm, double length_s = 10) {
    std::normal_distribution<double> normal;
    return swing_recording(seed, 2, static_cast<Index>(length_s * 100), [&](const auto& state, auto& random) {
      const auto& [q, qd, qdd] = state;
      VectorXd torque = regressor_.at(q, qd, qdd) * regressor_.model_parameters();
      for (Index j = 0; j < 2; ++j)
        torque(j) = torque(j) + std::copysign(2.0, qd(j)) + qd(j) + noise_nm * normal(random);
      return torque;
    });
  }

  Fitted fitted(const RobotRecording& recording, const DynamicsOptions& options = {}) const {
    JointMotion motion = *prepare({&recording, 1}, regressor_);
    auto fit = fit_dynamics(regressor_, base_, friction_, motion, options);
    EXPECT_TRUE(fit) << fit.error().message;
    ConsistentDynamics consistent = consistent_dynamics(regressor_, base_, friction_, *fit);
    measure_growth(regressor_, base_, friction_, *fit, motion, 1, consistent);
    return {std::move(motion), *std::move(fit), std::move(consistent)};
  }

  /// Mean square of the error on another recording.
  double error(const RobotParameters& parameters, const RobotRecording& unseen) const {
    const JointMotion motion = *prepare({&unseen, 1}, regressor_);
    const MatrixXd off = predicted_torque(regressor_, base_, friction_, parameters, motion, 1) - motion.torque;
    return motion.moving.select(off, 0).squaredNorm();
  }

 private:
  std::shared_ptr<const mujoco::Model> model_;
  Regressor regressor_ = *Regressor::create(model_->get());
  BaseParameters base_ = base_parameters(regressor_);
  RobotFriction friction_ = *robot_friction(*model_, regressor_, coulomb_viscous());
};

double smallest_eigenvalue(const VectorXd& body) {
  const double half = 0.5 * (body(0) + body(3) + body(5));
  MatrixXd J(4, 4);
  J << half - body(0), -body(1), -body(2), body(6), -body(1), half - body(3), -body(4), body(7), -body(2), -body(4),
      half - body(5), body(8), body(6), body(7), body(8), body(9);
  return symmetric_eigenvalues(J)(0);
}

/// In the order of DynamicsFit::unknowns.
VectorXd unknowns_of(const Fitted& f, const RobotParameters& parameters) {
  VectorXd all(parameters.base.size());
  all << parameters.base;
  for (const auto& rotor : parameters.friction) {
    const Index before = all.size();
    all.conservativeResize(before + std::ssize(rotor));
    all.tail(std::ssize(rotor)) = Eigen::Map<const VectorXd>(rotor.data(), std::ssize(rotor));
  }
  return all(f.fit.unknowns);
}

TEST(Consistency, OfAFitIsTheMinimumOverRealBodies) {
  Arm arm;
  int changed = 0;
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  for (unsigned seed = 1; seed <= 8; ++seed) {
    SCOPED_TRACE(seed);
    const Fitted f = arm.fitted(arm.recording(seed, 1.5));
    const VectorXd& bodies = f.consistent.bodies;
    for (Index b = 0; b < 2; ++b) EXPECT_GT(smallest_eigenvalue(bodies.segment(10 * b, 10)), 0);
    EXPECT_GT(bodies.tail(2).minCoeff(), 0);
    EXPECT_LT((arm.base().from_all * bodies - f.consistent.parameters.base).norm(), 1e-9);
    if (f.consistent.same) continue;
    ++changed;
    const VectorXd x = unknowns_of(f, f.consistent.parameters) - unknowns_of(f, f.fit.parameters);
    const VectorXd slope = f.fit.objective.transpose() * f.fit.objective * x;
    const auto n = static_cast<Index>(arm.base().size());
    const double cost = (f.fit.objective * x).squaredNorm();
    EXPECT_GT(cost, 0);
    for (int k = 0; k < 100; ++k) {  // other bodies: L L' with any L, of the size of the model's
      VectorXd other = arm.regressor().model_parameters();
      for (Index b = 0; b < 2; ++b) {
        Matrix4d L;
        for (double& l : L.reshaped()) l = 0.3 * normal(random);
        const Matrix4d J = L * L.transpose();
        other.segment(10 * b, 10) << J(1, 1) + J(2, 2), -J(0, 1), -J(0, 2), J(0, 0) + J(2, 2), -J(1, 2),
            J(0, 0) + J(1, 1), J(0, 3), J(1, 3), J(2, 3), J(3, 3);
      }
      other.tail(2) << std::abs(normal(random)), 0.1 * std::abs(normal(random));
      EXPECT_GT(slope.head(n).dot(arm.base().from_all * other - f.consistent.parameters.base), -0.01);
    }
    EXPECT_LT(slope.tail(slope.size() - n).norm(), 1e-6 * slope.head(n).norm());  // friction follows
    EXPECT_GE(f.consistent.growth.minCoeff(), 0.99);
    EXPECT_LT(f.consistent.growth.maxCoeff(), 1.05);
  }
  EXPECT_GE(changed, 4);
}

// Many parameters that the data hardly determine hide one that is impossible in the distance of all.
TEST(Consistency, ARotorFarBelowZeroIsNoRealOne) {
  const Arm arm("0 1 0");
  const BaseParameters& base = arm.base();
  VectorXd beta = base.from_all * arm.regressor().model_parameters();
  const VectorXd sigma = (0.1 * beta.cwiseAbs()).cwiseMax(0.01);
  const MatrixXd information = sigma.cwiseAbs2().cwiseInverse().asDiagonal();
  EXPECT_TRUE(nearest_consistent(arm.regressor(), base, beta, information).possible);
  int rotors = 0;
  for (Index k = 0; k < base.size(); ++k) {
    if (!base.parameters[static_cast<std::size_t>(k)].name.ends_with(".Ia")) continue;
    ++rotors;
    for (const auto& [sigmas, possible] : {std::pair{1.0, true}, {3.5, false}}) {
      VectorXd off = beta;
      off(k) = -sigmas * sigma(k);
      EXPECT_EQ(nearest_consistent(arm.regressor(), base, off, information).possible, possible)
          << base.parameters[static_cast<std::size_t>(k)].name << " " << sigmas;
    }
  }
  EXPECT_GT(rotors, 0) << base.parameters.front().name << " " << base.parameters.back().name;
}

TEST(Consistency, LeavesTheParametersOfRealBodiesAsTheyAre) {
  Arm arm;
  const Fitted f = arm.fitted(arm.recording(1, 0.01));
  EXPECT_TRUE(f.consistent.same);
  EXPECT_EQ(f.consistent.parameters.base, f.fit.parameters.base);
  EXPECT_EQ(f.consistent.parameters.friction, f.fit.parameters.friction);
  EXPECT_LT((arm.base().from_all * f.consistent.bodies - f.fit.parameters.base).norm(), 1e-9);
  EXPECT_EQ(f.consistent.growth, VectorXd::Ones(2));
}

TEST(Consistency, KeepsRotorsOutThatAnOptionExcludes) {
  Arm arm("0 1 0");
  const Fitted f = arm.fitted(arm.recording(2, 1.5), {.rotor_inertia = false});
  int excluded = 0;
  for (Index k = 0; k < arm.base().size(); ++k)
    if (arm.base().parameters[static_cast<std::size_t>(k)].name.ends_with(".Ia")) {
      EXPECT_EQ(f.consistent.parameters.base(k), 0);
      ++excluded;
    }
  EXPECT_GT(excluded, 0);
}

TEST(Consistency, PredictsOtherMotionsNoWorse) {
  Arm arm;
  double of_free = 0, of_real = 0;
  for (unsigned seed = 1; seed <= 8; ++seed) {
    const Fitted f = arm.fitted(arm.recording(seed, 1.5));
    const RobotRecording unseen = arm.recording(seed + 100, 0);
    of_free += arm.error(f.fit.parameters, unseen), of_real += arm.error(f.consistent.parameters, unseen);
  }
  EXPECT_LT(of_real, of_free);
}

TEST(DynamicsFile, KeepsConsistentParametersRangesAndBands) {
  Arm arm;
  for (const double noise_nm : {0.01, 1.5}) {
    SCOPED_TRACE(noise_nm);
    Fitted f = arm.fitted(arm.recording(3, noise_nm));
    EXPECT_EQ(f.consistent.same, noise_nm < 1);
    f.consistent.predict_worse = noise_nm > 1;
    const MatrixXd load = gear_load(arm.regressor(), arm.base(), f.fit.parameters.base, f.motion, 1);
    const auto file = std::filesystem::path(testing::TempDir()) / "consistent.yaml";
    std::ofstream(file) << to_yaml(
        f.fit, arm.base(), coulomb_viscous(), arm.regressor(),
        nearest_consistent(arm.regressor(), arm.base(), f.fit.parameters.base, f.fit.information),
        {.model = "arm.xml",
         .ranges = ranges_of(f.motion, load, false),
         .band = Eigen::Vector2d(std::nan(""), 0.3),
         .consistent = f.consistent});
    const auto read = read_dynamics(file, arm.regressor(), arm.base());
    ASSERT_TRUE(read) << read.error().message;
    ASSERT_TRUE(read->consistent);
    EXPECT_EQ(read->consistent->same, f.consistent.same);
    EXPECT_EQ(read->consistent->predict_worse, noise_nm > 1);
    EXPECT_EQ(read->consistent->parameters.base, f.consistent.parameters.base);
    EXPECT_EQ(read->consistent->parameters.friction, f.consistent.parameters.friction);
    EXPECT_EQ(read->parameters.base, f.fit.parameters.base);
    EXPECT_THAT(read->band, testing::ElementsAre(testing::IsNan(), 0.3));
    const auto friction = read_friction(file);
    ASSERT_TRUE(friction) << friction.error().message;
    ASSERT_EQ(friction->size(), 2u);
    for (std::size_t j = 0; j < 2; ++j) {
      const FrictionEstimates& joint = (*friction)[j];
      EXPECT_EQ(joint.law, "coulomb_viscous");
      EXPECT_TRUE(joint.correlated);
      ASSERT_EQ(joint.estimates.size(), f.fit.friction[j].size());
      for (std::size_t p = 0; p < joint.estimates.size(); ++p)
        EXPECT_EQ(joint.estimates[p].value, f.fit.friction[j][p].value);
      const MatrixXd& was = f.fit.friction_covariance[j];
      ASSERT_TRUE(was.allFinite());
      EXPECT_LT((joint.covariance - was).norm(), 1e-9 * was.norm());
      EXPECT_GT(std::abs(was(0, 1)), 0.01 * std::sqrt(was(0, 0) * was(1, 1))) << "else nothing is kept";
    }
    ASSERT_EQ(read->ranges.size(), 2u);
    for (std::size_t k = 0; k < ranged_infos.size(); ++k) {
      const Span &kept = read->ranges[1][k], was = ranges_of(f.motion, load, false)[1][k];
      EXPECT_EQ(kept.known(), ranged_infos[k].name != "temperature");
      EXPECT_EQ(kept.low, was.low);
      EXPECT_EQ(kept.high, was.high);
    }
  }
}

}  // namespace
}  // namespace tribotwin::twin::identification
