#include <cmath>
#include <memory>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/tests/twin/identification/multisine.hpp>
#include <tribotwin/twin/identification/drive_gains/drive_gains.hpp>
#include <tribotwin/twin/identification/drive_gains/efficiency.hpp>
#include <tribotwin/twin/identification/drive_gains/report.hpp>

/// An arm of six axes whose torques are recorded with wrong gains, without and with a payload. Torques are the
/// regressor's, which are mj_inverse's (dynamics_test), plus friction that grows with the load and falls with the
/// temperature, ripple and noise.
namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
using testing::HasSubstr;

constexpr auto arm_xml = R"(<mujoco><compiler angle="radian"/><worldbody><body name="b1" pos="0 0 .4">
  <joint name="j1" axis="0 0 1" armature=".8"/><inertial pos=".05 0 .1" mass="8" diaginertia=".1 .1 .08"/>
  <body name="b2" pos=".1 0 .2"><joint name="j2" axis="0 1 0" armature=".9"/>
    <inertial pos=".25 .02 0" mass="6" diaginertia=".03 .2 .2"/>
  <body name="b3" pos=".5 0 0"><joint name="j3" axis="0 1 0" armature=".4"/>
    <inertial pos=".1 -.02 .05" mass="4" diaginertia=".02 .05 .05"/>
  <body name="b4" pos=".3 0 0"><joint name="j4" axis="1 0 0" armature=".1"/>
    <inertial pos=".05 .01 0" mass="1.5" diaginertia=".005 .01 .01"/>
  <body name="b5" pos=".15 0 0"><joint name="j5" axis="0 1 0" armature=".08"/>
    <inertial pos=".03 0 .01" mass="1" diaginertia=".003 .003 .003"/>
  <body name="b6" pos=".08 0 0"><joint name="j6" axis="1 0 0" armature=".05"/>
    <inertial pos=".02 0 0" mass=".4" diaginertia=".0005 .0004 .0004"/>
    <site name="flange" pos=".03 0 0" euler="0 1.5707963 0"/>{}</body></body></body></body></body></body>
  </worldbody></mujoco>)";

std::shared_ptr<const mujoco::Model> arm_model(const char* at_flange = "") {
  std::string text = arm_xml;
  text.replace(text.find("{}"), 2, at_flange);
  auto model = mujoco::load_string(text);
  EXPECT_TRUE(model) << model.error().message;
  return *model;
}

constexpr double gain_of_joint[] = {0.8, 1.3, 1.1, 0.9, 1.25, 0.95};
constexpr double coulomb_nm[] = {6, 6, 4, 1.5, 1.2, 0.8}, viscous_nm_s[] = {5, 5, 3, 1, 1, 0.5};
constexpr double noise_share = 0.02;  ///< of the largest torque of the joint
constexpr double per_load = 0.08;
constexpr const char* known = "3.2 kg at 0.06 0.02 0.08 inertia 0.012 0.012 0.01";

class Arm {
 public:
  const Regressor& regressor() const { return regressor_; }
  const BaseParameters& base() const { return base_; }
  const mujoco::Model& model() const { return *model_; }
  VectorXd truth() const { return base_.from_all * phi_; }

  PlacedPayload payload(const std::string& text) const {
    const auto given = known_payload("loaded.csv=" + text);
    EXPECT_TRUE(given) << given.error().message;
    const auto found = placed(*given, regressor_);
    EXPECT_TRUE(found) << found.error().message;
    return *found;
  }

  /// The same motion for the same seed; noise differs.
  RobotRecording recording(const VectorXd* payload, unsigned motion_seed, unsigned noise_seed, double scale = 1) {
    constexpr double rate_hz = 50, length_s = 30;
    const auto samples = static_cast<Index>(rate_hz * length_s);
    std::mt19937_64 motion(motion_seed), random(noise_seed);
    std::normal_distribution<double> normal;
    const Multisine swing(6, motion, {.first_hz = 0.13, .next_hz = 0.17, .per_joint_hz = 0.03, .amplitude_rad = 0.9});
    RobotRecording r{.file = payload ? "loaded.csv" : "bare.csv"};
    r.position.resize(6, samples), r.torque.resize(6, samples);
    const Index carried = first_column(regressor_, 6);
    for (Index i = 0; i < samples; ++i) {
      const double t = static_cast<double>(i) / rate_hz;
      r.time_s.push_back(t);
      const auto [q, qd, qdd] = swing.at(t);
      const MatrixXd& Y = regressor_.at(q, qd, qdd);
      VectorXd rigid = Y * phi_;
      if (payload) rigid += Y.middleCols(carried, 10) * *payload;
      r.position.col(i) = q;
      const double warm = (payload ? 0.8 : 1.1) * std::exp(-0.1 * t / length_s);
      for (Index j = 0; j < 6; ++j)
        r.torque(j, i) = rigid(j) + friction(j, qd(j), rigid(j) - armature(j) * qdd(j), warm);
    }
    for (Index j = 0; j < 6; ++j) {
      const double largest = r.torque.row(j).cwiseAbs().maxCoeff();
      for (Index i = 0; i < samples; ++i) {
        const double ripple = 0.005 * std::sin(31 * r.position(j, i) + static_cast<double>(j));
        r.torque(j, i) += largest * (ripple + noise_share * normal(random));
        r.torque(j, i) /= gain_of_joint[j] * scale;
      }
    }
    return r;
  }

  JointMotion motion(const VectorXd& payload, unsigned seed, double scale = 1) {
    const std::vector<RobotRecording> both{recording(nullptr, seed, 2 * seed, scale),
                                           recording(&payload, seed, 2 * seed + 1, scale)};
    const auto out = prepare(both, regressor_, {.cutoff_hz = 5, .decimation = 2});
    EXPECT_TRUE(out) << out.error().message;
    return *out;
  }

  Result<DriveGains> gains(const JointMotion& motion, const std::string& text) const {
    const std::vector<PlacedPayload> payloads{payload(text)};
    return identify_drive_gains(regressor_, base_, motion, payloads, std::vector<int>{-1, 0}, 2);
  }

 private:
  double armature(Index j) const { return phi_(phi_.size() - 6 + j); }
  static double friction(Index j, double v, double load, double warm) {
    return std::copysign(warm * coulomb_nm[j] + per_load * std::abs(load), v) + warm * viscous_nm_s[j] * v;
  }

  std::shared_ptr<const mujoco::Model> model_ = arm_model();
  Regressor regressor_ = *Regressor::create(model_->get());
  BaseParameters base_ = base_parameters(regressor_);
  VectorXd phi_ = regressor_.model_parameters();
};

TEST(KnownPayload, IsReadAndRefusedWithItsForm) {
  const auto full = known_payload("runs/a=b.csv=3.2 kg +- 0.05 at 0 0.01 0.08 +- 0.002 inertia 1 1 1 0 0 0.1 on tool");
  ASSERT_TRUE(full) << full.error().message;
  EXPECT_EQ(full->file, "runs/a=b.csv");
  EXPECT_EQ(full->mass_kg, 3.2);
  EXPECT_EQ(full->mass_sigma_kg, 0.05);
  EXPECT_EQ(*full->centre_m, Eigen::Vector3d(0, 0.01, 0.08));
  EXPECT_EQ(full->centre_sigma_m, 0.002);
  EXPECT_EQ((*full->inertia_kg_m2)(5), 0.1);
  EXPECT_EQ(full->on, "tool");
  EXPECT_FALSE(known_payload("a.csv=3 kg")->centre_m);
  const struct {
    const char *text, *says;
  } wrong[] = {{"3.2 kg", "no file"},
               {"a.csv=3.2", "with its unit"},
               {"a.csv=3200 g", "with its unit"},
               {"a.csv=-1 kg", "above 0"},
               {"a.csv=nan kg", "above 0"},
               {"a.csv=3 kg +- x", "'+-' needs"},
               {"a.csv=3 kg +- 2", "weigh"},
               {"a.csv=3 kg at 0 0", "it has 2"},
               {"a.csv=3 kg at 0 0 80", "in m"},
               {"a.csv=3 kg at 0 0 0 at 0 0 0", "'at' is not understood"},
               {"a.csv=3 kg inertia 1 1 1", "about the centre"},
               {"a.csv=3 kg at 0 0 0 inertia 1 1", "it has 2 numbers"},
               {"a.csv=3 kg at 0 0 0 inertia 1 1 3", "any real body"},
               {"a.csv=3 kg on", "'on' is not understood"}};
  for (const auto& w : wrong) {
    const auto read = known_payload(w.text);
    ASSERT_FALSE(read) << w.text;
    EXPECT_THAT(read.error().message, AllOf(HasSubstr(w.says), HasSubstr("FILE=\"MASS kg"))) << w.text;
  }
}

// A body that the model has at its flange, turned, needs the torques that its payload adds.
TEST(KnownPayload, ActsAsABodyOfTheModel) {
  Arm arm;
  const auto heavier = arm_model(
      R"(<body pos=".03 0 0" euler="0 1.5707963 0"><inertial pos=".06 .02 .08" mass="3.2" diaginertia=".012 .012 .01"/>
         </body>)");
  Regressor with = *Regressor::create(heavier->get()), without = arm.regressor();
  const PlacedPayload payload = arm.payload(known);
  EXPECT_EQ(payload.spread.cols(), 0);
  const VectorXd q = VectorXd::LinSpaced(6, -1, 1), qd = VectorXd::LinSpaced(6, 2, -1),
                 qdd = VectorXd::LinSpaced(6, -3, 2);
  const VectorXd added =
      with.at(q, qd, qdd) * with.model_parameters() - without.at(q, qd, qdd) * without.model_parameters();
  const VectorXd own =
      without.last().middleCols(first_column(without, payload.body.body), 10) * payload.body.parameters;
  EXPECT_LT((added - own).norm(), 1e-6 * added.norm());
  EXPECT_FALSE(placed(*known_payload("a.csv=1 kg on hook"), without));
  EXPECT_EQ(placed(*known_payload("a.csv=1 kg on b5"), without)->body.body, 5);
}

// 95 % intervals of gains contain the truth although torque ripples, friction grows with the load and the payload is
// known only as its +- says; those of base parameters do once the gains are counted.
TEST(DriveGains, AreFoundWithinTheirIntervals) {
  Arm arm;
  const VectorXd truth = arm.truth();
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  double inside = 0, intervals = 0, base_inside = 0, base_intervals = 0, z2 = 0;
  for (unsigned seed = 1; seed <= 11; ++seed) {
    const double mass = 3.2 + 0.03 * normal(random);
    const VectorXd payload =
        arm.payload(fmt::format("{} kg at 0.06 0.02 0.08 inertia 0.012 0.012 0.01", mass)).body.parameters;
    JointMotion motion = arm.motion(payload, seed);
    const auto found = arm.gains(motion, "3.2 kg +- 0.03 at 0.06 0.02 0.08");
    ASSERT_TRUE(found) << found.error().message;
    EXPECT_THAT(found->lacking, testing::IsEmpty());
    for (Index j = 0; j < 6; ++j) {
      const Estimate& e = found->factors[static_cast<std::size_t>(j)];
      inside += e.low <= gain_of_joint[j] && gain_of_joint[j] <= e.high, ++intervals;
      z2 += std::pow((e.value - gain_of_joint[j]) / e.sigma, 2);
      EXPECT_LT(e.sigma, 0.06 * e.value) << e.name;
      motion.torque.row(j) *= e.value;
    }
    motion.carried_torque = carried_torque(
        arm.regressor(), std::vector<std::optional<CarriedBody>>{{}, CarriedBody{6, found->payload[0]}}, motion);
    const auto friction = robot_friction(arm.model(), arm.regressor(), coulomb_viscous_load(), {.offset = true},
                                         std::vector<double>(6, 100));
    auto fit = fit_dynamics(arm.regressor(), arm.base(), *friction, motion);
    ASSERT_TRUE(fit) << fit.error().message;
    count_gains(*found, *fit);
    for (std::size_t b = 0; b < fit->base.size(); ++b)
      base_inside +=
          fit->base[b].low <= truth(static_cast<Index>(b)) && truth(static_cast<Index>(b)) <= fit->base[b].high,
          ++base_intervals;
    const auto efficiencies = transmission_efficiency(*found);
    EXPECT_THAT(efficiencies, testing::SizeIs(6));
    for (const Efficiency& e : efficiencies) {
      EXPECT_NEAR(e.per_load.value, per_load, 4 * e.per_load.sigma) << e.joint;
      EXPECT_NEAR(e.driving.value, 1 / (1 + per_load), 4 * e.driving.sigma) << e.joint;
      EXPECT_NEAR(e.backdriven.value, 1 - per_load, 4 * e.backdriven.sigma) << e.joint;
    }
  }
  fmt::print("{:.1f} % of {:.0f} intervals, rms z {:.2f}; base parameters {:.1f} %\n", 100 * inside / intervals,
             intervals, std::sqrt(z2 / intervals), 100 * base_inside / base_intervals);
  EXPECT_GT(inside / intervals, 0.90);
  EXPECT_NEAR(std::sqrt(z2 / intervals), 1, 0.3);
  EXPECT_GT(base_inside / base_intervals, 0.90);
}

TEST(Efficiency, IsThatOfTheLoadTerm) {
  Arm arm;
  const auto friction = robot_friction(arm.model(), arm.regressor(), coulomb_viscous_load(), {.offset = true},
                                       std::vector<double>{50, 40, 30, 20, 10, 5});
  DynamicsFit fit;
  for (const double value : {5.0, -4.0, 45.0, 0.0, 1.0, 5.0}) {
    fit.joints.push_back({.name = "j", .samples = 100});
    fit.friction.push_back(
        {{.name = "Fc"}, {.name = "Fcl", .value = value, .sigma = 1, .low = value - 2, .high = value + 2}});
  }
  fit.joints[3].samples = 0;
  fit.friction[4][1].sigma = std::nan("");
  const auto found = transmission_efficiency(*friction, fit);
  const struct {
    double per_load, sigma, driving, driving_sigma, backdriven;
  } expected[] = {{0.1, 0.02, 1 / 1.1, 0.02 / 1.21, 0.9},
                  {-0.1, 0.025, 1 / 0.9, 0.025 / 0.81, 1.1},
                  {1.5, 1.0 / 30, 0.4, 1 / 30.0 / 6.25, -0.5},
                  {1, 0.2, 0.5, 0.05, 0}};
  ASSERT_EQ(found.size(), std::size(expected));
  for (std::size_t k = 0; k < found.size(); ++k) {
    EXPECT_DOUBLE_EQ(found[k].per_load.value, expected[k].per_load);
    EXPECT_DOUBLE_EQ(found[k].per_load.sigma, expected[k].sigma);
    EXPECT_DOUBLE_EQ(found[k].driving.value, expected[k].driving);
    EXPECT_DOUBLE_EQ(found[k].driving.sigma, expected[k].driving_sigma);
    EXPECT_DOUBLE_EQ(found[k].backdriven.value, expected[k].backdriven);
  }
  EXPECT_THAT(table_of(found), HasSubstr("locks itself"));
  const auto plain = robot_friction(arm.model(), arm.regressor(), coulomb_viscous());
  EXPECT_THAT(transmission_efficiency(*plain, fit), testing::IsEmpty());
}

TEST(DriveGains, AreAsUncertainAsTheMass) {
  Arm arm;
  const VectorXd payload = arm.payload(known).body.parameters;
  const JointMotion motion = arm.motion(payload, 3, 50);  // amperes: 1 / 50 of the torque
  const auto exact = arm.gains(motion, known), within = arm.gains(motion, std::string("3.2 kg +- 0.16") + (known + 6)),
             twice = arm.gains(motion, std::string("6.4 kg") + (known + 6));
  ASSERT_TRUE(exact && within && twice);
  for (std::size_t j = 0; j < 6; ++j) {
    const double ln = exact->factors[j].sigma / exact->factors[j].value,
                 wider = within->factors[j].sigma / within->factors[j].value;
    EXPECT_NEAR(exact->factors[j].value, 50 * gain_of_joint[j], 4 * exact->factors[j].sigma);
    EXPECT_NEAR(wider, std::hypot(ln, 0.05), 0.15 * wider) << j;
  }
  // Nothing but the assumed constants contradicts a mass that is wrong; the note says so.
  std::vector<AssumedGain> assumed(6);
  EXPECT_THAT(doubtful_mass(*exact, assumed), testing::IsEmpty());
  EXPECT_THAT(table_of(*exact, assumed, std::vector{*known_payload(std::string("a=") + known)}),
              HasSubstr("1 % more makes every gain 1 % larger"));
}

TEST(DriveGains, SayWhatTheRecordingsDoNotTell) {
  Arm arm;
  // A point on the axis of j6 does not load it, and hardly anything of j6 acts on other joints.
  constexpr const char* on_axis = "3.2 kg at 0 0 0.08 inertia 0 0 0";
  JointMotion motion = arm.motion(arm.payload(on_axis).body.parameters, 4);
  motion.leave_out(3);
  const auto found = arm.gains(motion, on_axis);
  ASSERT_TRUE(found) << found.error().message;
  for (const std::size_t j : {0, 1, 2, 4}) EXPECT_TRUE(found->known(j)) << j;
  EXPECT_FALSE(found->known(3));
  EXPECT_FALSE(found->known(5)) << found->factors[5].value << " +- " << found->factors[5].sigma;
  EXPECT_LT(found->factors[5].low, gain_of_joint[5]);
  EXPECT_GT(found->factors[5].high, gain_of_joint[5]);
  const auto json = json_of(*found, std::vector<AssumedGain>(6));
  EXPECT_TRUE(json["j6"]["value"].is_null());
  EXPECT_THAT(json["j6"]["record_next"], HasSubstr("off the axis of j6"));
  EXPECT_THAT(json["j4"]["reason"], HasSubstr("not recorded"));
}

TEST(DriveGains, RefuseWhatContradictsThePayload) {
  Arm arm;
  const JointMotion motion = arm.motion(arm.payload(known).body.parameters, 5);
  const auto centres = [&](const std::string& text) {
    const std::vector<KnownPayload> payloads{*known_payload("loaded.csv=" + text)};
    return doubtful_centres(arm.regressor(), arm.base(), motion, payloads, std::vector<int>{-1, 0}, 2);
  };
  EXPECT_THAT(centres(known), testing::IsEmpty());
  EXPECT_THAT(centres("3.2 kg at 0.06 0.02 0.13"), testing::ElementsAre(HasSubstr("is at 0.06")));
  EXPECT_THAT(centres("3.2 kg at 0.06 0.02 0.13 +- 0.05"), testing::IsEmpty());
  const std::vector<PlacedPayload> one{arm.payload(known)};
  const auto refused = [&](std::span<const PlacedPayload> payloads, int bare, int loaded) {
    const auto r =
        identify_drive_gains(arm.regressor(), arm.base(), motion, payloads, std::vector<int>{bare, loaded}, 2);
    return r ? "" : r.error().message;
  };
  EXPECT_THAT(refused({}, -1, -1), HasSubstr("Record the same motions once more with a payload"));
  EXPECT_THAT(refused(one, 0, 0), HasSubstr("once more without it"));
  EXPECT_THAT(refused(one, 0, -1), HasSubstr("the wrong way"));
}

}  // namespace
}  // namespace tribotwin::twin::identification
