#include <cmath>
#include <fstream>
#include <memory>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/tests/twin/identification/multisine.hpp>
#include <tribotwin/twin/identification/dynamics_choice/dynamics_choice.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics_file.hpp>
#include <tribotwin/twin/robot/inertial_prior/inertial_prior.hpp>

/// A robot of two joints whose recordings have the defects of real ones. Its torques are the regressor's, which are
/// mj_inverse's (dynamics_test), plus friction and what the recording adds.
namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

constexpr auto arm_xml = R"(<mujoco><worldbody>
  <body name="upper"><joint name="shoulder" axis="0 1 0" armature=".4"/>
    <geom type="capsule" size=".05" fromto="0 0 0 .5 0 0" mass="6"/>
  <body name="fore" pos=".5 0 0"><joint name="elbow" axis="0 1 0" armature=".2"/>
    <geom type="capsule" size=".04" fromto="0 0 0 .4 0 0" mass="3"/></body></body>
  </worldbody></mujoco>)";

/// What is in a recording beside rigid dynamics. Torques in Nm.
struct Defects {
  double coulomb_nm = 4, viscous_nm_s = 2;
  double offset_nm = 0, asymmetry = 0, stribeck_nm = 0, per_load = 0, ripple = 0;
  double noise_nm = 0.3, noise_memory = 0;  ///< correlation of the noise from one sample to the next
  double position_step_rad = 1e-6;
  double outliers = 0;           ///< share of samples
  double by_position_nm = 0;     ///< of the elbow: this times cos q - sin q
  double coupled_nm = 0;         ///< Coulomb friction of an elbow motor that turns with both joints
  double fed_forward_kg_m2 = 0;  ///< of the elbow: its torque is what the drive adds to this times its acceleration
  bool velocity = false;
};

class Arm {
 public:
  const mujoco::Model& model() const { return *model_; }
  const Regressor& regressor() const { return regressor_; }
  const BaseParameters& base() const { return base_; }

  RobotRecording recording(const Defects& d, unsigned seed, double length_s = 8, double rate_hz = 125) {
    std::mt19937_64 random(seed);
    const auto samples = static_cast<Index>(length_s * rate_hz);
    RobotRecording r{.file = fmt::format("{}.csv", seed)};
    r.position.resize(2, samples), r.torque.resize(2, samples);
    if (d.velocity) r.velocity.resize(2, samples);
    const Multisine swing(2, random);
    double noise[2] = {0, 0};
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform(0, 1);
    for (Index i = 0; i < samples; ++i) {
      const double t = static_cast<double>(i) / rate_hz;
      r.time_s.push_back(t);
      const auto [q, qd, qdd] = swing.at(t);
      const VectorXd rigid = regressor_.at(q, qd, qdd) * phi_;
      for (Index j = 0; j < 2; ++j) {
        const double sign = qd(j) < 0 ? -1 : 1, load = std::abs(rigid(j) - phi_(phi_.size() - 2 + j) * qdd(j));
        const double level = d.coulomb_nm + d.viscous_nm_s * std::abs(qd(j)) + d.per_load * load +
                             d.stribeck_nm * std::exp(-std::abs(qd(j)) / 0.3);
        noise[j] =
            d.noise_memory * noise[j] + std::sqrt(1 - d.noise_memory * d.noise_memory) * d.noise_nm * normal(random);
        double torque = rigid(j) + sign * level * (1 + d.asymmetry * sign) + d.offset_nm + noise[j];
        torque += std::copysign(d.coupled_nm, qd.sum());
        if (j == 1) torque -= d.fed_forward_kg_m2 * qdd(j);
        if (j == 1) torque += d.by_position_nm * (std::cos(q(j)) - std::sin(q(j)));
        torque *= 1 + d.ripple * std::sin(37 * q(j) + swing.phase(j, 0));
        if (uniform(random) < d.outliers) torque += 60 * normal(random);
        r.position(j, i) = d.position_step_rad * std::round(q(j) / d.position_step_rad);
        r.torque(j, i) = torque;
        if (d.velocity) r.velocity(j, i) = qd(j);
      }
    }
    return r;
  }

  /// Bodies that are the model's within a prior of that share.
  void deviate(double share, unsigned seed) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    phi_ = regressor_.model_parameters();
    const VectorXd scale = inertial_scale(regressor_);
    for (Index k = 0; k < phi_.size(); ++k) phi_(k) += share * scale(k) * normal(random);
  }
  VectorXd true_base() const { return base_.from_all * phi_; }

  std::vector<RobotRecording> recordings(const Defects& d, unsigned seed) {
    return {recording(d, seed), recording(d, seed + 1), recording(d, seed + 2)};
  }

  /// rms of the prediction's error on a recording that was not fitted, geometric mean over joints.
  double error(const Setting& s, const std::vector<RobotRecording>& training, const RobotRecording& unseen) const {
    const auto torque_max = std::vector<double>{100, 50};
    const auto motion = prepare(training, regressor_, s.signals);
    const auto friction = friction_of(*model_, regressor_, s, torque_max, *motion);
    const auto fit = fit_dynamics(regressor_, base_, *friction, *motion,
                                  {.robust = s.robust, .rotor_inertia = s.rotor_inertia, .prior = s.prior});
    if (!fit) return std::numeric_limits<double>::infinity();
    const auto test = prepare({&unseen, 1}, regressor_, s.signals);
    Preparation also_near_reversals = s.signals;
    also_near_reversals.reversals = true;
    const auto counting = prepare({&unseen, 1}, regressor_, also_near_reversals)->moving;  // the same for every setting
    const MatrixXd predicted = predicted_torque(regressor_, base_, *friction, fit->parameters, *test, 2);
    double sum = 0;
    for (Index j = 0; j < 2; ++j) {
      double squares = 0, count = 0;
      for (Index i = 0; i < test->size(); ++i)
        if (counting(j, i)) squares += std::pow(predicted(j, i) - test->torque(j, i), 2), ++count;
      sum += 0.5 * std::log(squares / count) / 2;
    }
    return std::exp(sum);
  }

  DynamicsChoice choice(const std::vector<RobotRecording>& training, const Decided& decided = {}) const {
    const std::vector<double> torque_max{100, 50};
    auto out = choose_dynamics(*model_, regressor_, base_, training, decided, torque_max, 2);
    EXPECT_TRUE(out) << out.error().message;
    return *out;
  }

 private:
  std::shared_ptr<const mujoco::Model> model_ = *mujoco::load_string(arm_xml);
  Regressor regressor_ = *Regressor::create(model_->get());
  BaseParameters base_ = base_parameters(regressor_);
  VectorXd phi_ = regressor_.model_parameters();
};

/// The smallest error among settings that a person would try.
double best_by_hand(const Arm& arm, const std::vector<RobotRecording>& training, const RobotRecording& unseen,
                    double cutoff_hz, bool recorded_velocity) {
  double best = std::numeric_limits<double>::infinity();
  for (const char* law : {"", "stribeck", "coulomb_viscous_load"})
    for (const bool asymmetry : {false, true})
      for (const Robust robust : {Robust::none, Robust::tukey}) {
        Setting s{.signals = {.cutoff_hz = cutoff_hz, .recorded_velocity = recorded_velocity}};
        if (*law) s.law = *dynamics_law(law, "law");
        s.directional.asymmetry = asymmetry, s.robust = robust;
        best = std::min(best, arm.error(s, training, unseen));
      }
  return best;
}

struct Case {
  const char* name;
  Defects defects;
};

class Choice : public testing::TestWithParam<Case> {};

TEST_P(Choice, PredictsAsWellAsTheBestSettingByHand) {
  Arm arm;
  const auto training = arm.recordings(GetParam().defects, 10);
  const auto unseen = arm.recording(GetParam().defects, 20);
  const DynamicsChoice choice = arm.choice(training);
  for (const Trial& t : choice.trials)
    if (t.taken) fmt::print("{}: {:+.2f} % +- {:.2f}\n", t.what, 100 * t.change, 100 * t.sigma);
  const auto& signals = choice.setting.signals;
  EXPECT_LT(arm.error(choice.setting, training, unseen),
            1.05 * best_by_hand(arm, training, unseen, signals.cutoff_hz, signals.recorded_velocity));
}

INSTANTIATE_TEST_SUITE_P(Defects, Choice,
                         testing::Values(Case{"offset", {.offset_nm = 3}}, Case{"asymmetry", {.asymmetry = 0.3}},
                                         Case{"stribeck", {.stribeck_nm = 4, .noise_nm = 0.1}},
                                         Case{"load", {.per_load = 0.1, .noise_nm = 0.1}},
                                         Case{"outliers", {.outliers = 0.02}},
                                         Case{"encoder", {.position_step_rad = 2e-3, .velocity = true}}),
                         [](const auto& info) { return info.param.name; });

// A law of the speed that falls and rises again is linear with its shape held, and as good as the one with a free
// shape.
TEST(Choice, FindsTheStribeckEffectWithoutFittingItsShape) {
  Arm arm;
  const DynamicsChoice choice = arm.choice(arm.recordings({.stribeck_nm = 4, .noise_nm = 0.1}, 10), {.cutoff_hz = 20});
  EXPECT_EQ(choice.setting.law, &coulomb_viscous_stribeck());
  const auto motion =
      prepare(arm.recordings({.stribeck_nm = 4, .noise_nm = 0.1}, 10), arm.regressor(), {.cutoff_hz = 20});
  const auto friction = friction_of(arm.model(), arm.regressor(), choice.setting, {}, *motion);
  const auto fit = fit_dynamics(arm.regressor(), arm.base(), *friction, *motion);
  ASSERT_TRUE(fit) << fit.error().message;
  const Estimate& vs = fit->friction[0][3];
  EXPECT_EQ(vs.status, Status::held);
  EXPECT_NEAR(vs.value, choice.setting.stribeck_share[0] * motion->qd.row(0).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_GT(fit->friction[0][2].value, 10 * fit->friction[0][2].sigma) << "Fs";
}

const Trial* taken(const DynamicsChoice& choice, std::string_view what) {
  for (const Trial& t : choice.trials)
    if (t.taken && t.what.find(what) != std::string::npos) return &t;
  return nullptr;
}

TEST(Choice, TakesWhatTheRecordingsHave) {
  Arm arm;
  const DynamicsChoice plain = arm.choice(arm.recordings({}, 30), {.cutoff_hz = 12});
  EXPECT_EQ(plain.setting.signals.cutoff_hz, 12);
  EXPECT_FALSE(plain.setting.directional.asymmetry);
  EXPECT_TRUE(plain.by_file);
  EXPECT_THAT(plain.setting.motors, testing::IsEmpty());
  EXPECT_THAT(plain.setting.by_position, testing::IsEmpty());
  const DynamicsChoice coarse = arm.choice(arm.recordings({.position_step_rad = 2e-3, .velocity = true}, 50));
  EXPECT_TRUE(coarse.setting.signals.recorded_velocity);
  EXPECT_TRUE(taken(coarse, "recorded velocity"));
  const DynamicsChoice rough = arm.choice(arm.recordings({.position_step_rad = 2e-3}, 50));
  EXPECT_LT(rough.setting.signals.cutoff_hz, 15);
}

// A UR10 whose speeds come from a rough encoder predicts best below 2 Hz.
TEST(Choice, NarrowsTheBandWhileThatPredictsBetter) {
  Arm arm;
  const Defects defects{.noise_nm = 1, .position_step_rad = 2e-2};
  const std::vector training{arm.recording(defects, 10, 40), arm.recording(defects, 11, 40)};
  const DynamicsChoice choice = arm.choice(training);
  EXPECT_LT(choice.setting.signals.cutoff_hz, 5);
  Setting wider = choice.setting;
  wider.signals.cutoff_hz = 5;
  const RobotRecording unseen = arm.recording({.noise_nm = 1}, 20, 40);
  EXPECT_LT(arm.error(choice.setting, training, unseen), 0.9 * arm.error(wider, training, unseen));
}

TEST(Choice, SaysInWhichBandErrorsOfALagAreCounted) {
  Arm arm;
  constexpr double recorded_noise_nm = 1;
  auto recordings = arm.recordings({.noise_nm = recorded_noise_nm, .position_step_rad = 3e-3}, 40);
  EXPECT_EQ(arm.choice(recordings).lag_target_hz, 0);
  for (auto& r : recordings)
    for (Index i = r.torque.cols() - 1; i >= 3; --i) r.torque.col(i) = r.torque.col(i - 3);
  const DynamicsChoice choice = arm.choice(recordings);
  ASSERT_TRUE(taken(choice, "torques:"));
  EXPECT_EQ(choice.lag_target_hz, choice.setting.signals.cutoff_hz);
  // What the lag gains is not what a narrower band gains: it is the same where that band is the only one.
  const DynamicsChoice one_band = arm.choice(recordings, {.cutoff_hz = choice.lag_target_hz});
  ASSERT_TRUE(taken(one_band, "torques:"));
  EXPECT_NEAR(taken(choice, "torques:")->change, taken(one_band, "torques:")->change, 0.02);
  // Of white noise a band keeps the root of its share.
  const double noise_nm = recorded_noise_nm * std::sqrt(2 * choice.lag_target_hz / 125);
  EXPECT_THAT(choice.trials.back().rms,
              testing::Each(testing::AllOf(testing::Gt(0.8 * noise_nm), testing::Lt(1.5 * noise_nm))));
}

TEST(Choice, ComparesWithoutALagThatIsKnown) {
  Arm arm;
  const auto on_time = arm.recordings({}, 40);
  auto late = on_time;
  for (auto& r : late)
    for (Index i = r.torque.cols() - 1; i >= 3; --i) r.torque.col(i) = r.torque.col(i - 3);
  const Decided none{.cutoff_hz = 12, .law = &coulomb_viscous(), .coupling = true, .lag = true};
  Decided known = none;
  known.lag_s = {3 / 125., 3 / 125.};
  const DynamicsChoice choice = arm.choice(late, known);
  EXPECT_EQ(choice.setting.signals.lag_s, known.lag_s);
  const VectorXd rms = arm.choice(on_time, none).trials.front().rms;
  EXPECT_LT(choice.trials.front().rms(0), 1.1 * rms(0));
  EXPECT_GT(arm.choice(late, none).trials.front().rms(0), 1.5 * rms(0));
}

TEST(Choice, FindsAMotorThatTurnsWithTwoJoints) {
  Arm arm;
  const Decided quick{.cutoff_hz = 20, .law = &coulomb_viscous(), .asymmetry = false, .robust = Robust::none};
  const auto training = arm.recordings({.coupled_nm = 3}, 60);
  const DynamicsChoice choice = arm.choice(training, quick);
  ASSERT_THAT(choice.setting.motors, testing::SizeIs(1));
  EXPECT_EQ(choice.setting.motors[0].joint, 1);
  EXPECT_EQ(choice.setting.motors[0].turns_with, (VectorXd{{1, 1}}));
  EXPECT_TRUE(taken(choice, "motor of elbow: shoulder + elbow"));
  // By the motor's own direction little but the noise is left, 0.17 Nm below 20 Hz, of 3 Nm.
  EXPECT_LT(std::ranges::find(choice.trials, "motor of elbow: shoulder + elbow", &Trial::what)->rms.maxCoeff(), 0.35);
  Decided none = quick;
  none.coupling = true;
  EXPECT_THAT(arm.choice(training, none).setting.motors, testing::IsEmpty());
}

// A joint that one of two motions leaves at rest for a while says nothing of the other's error then.
TEST(HeldOut, ComparesStretchesThatBothHave) {
  const double none = std::numeric_limits<double>::quiet_NaN();
  const Errors a{.rms = VectorXd{{1, 2}}, .mean = Eigen::MatrixXd{{1, 1.2, 0.8, none}, {4, 4, 4, 4}}};
  const Errors b{.rms = VectorXd{{1.1, 2}}, .mean = Eigen::MatrixXd{{1.3, 1.1, none, 1.2}, {4, 4, 4, 4}}};
  const Comparison c = compared(a, b);
  EXPECT_NEAR(c.change, std::sqrt(1 / 1.1) - 1, 1e-12);
  // Of stretches: (1 - 1.3, 1.2 - 1.1) / (4 1.1^2) of both joints, and 0 where the second alone is known.
  const double first = -0.3 / 4.84, second = 0.1 / 4.84, mean = (first + second) / 4;
  const double squares = (first - mean) * (first - mean) + (second - mean) * (second - mean) + 2 * mean * mean;
  EXPECT_NEAR(c.sigma, std::sqrt(squares / 12), 1e-12);
}

// Of a robust fit too: who says which samples are outliers has not seen those that are predicted.
TEST(HeldOut, IsPredictedByTheOtherFilesAlone) {
  Arm arm;
  auto training = arm.recordings({.outliers = 0.05}, 80);
  const Setting s{.robust = Robust::tukey};
  const auto predicted = [&] {
    const auto motion = prepare(training, arm.regressor(), s.signals);
    const auto friction = friction_of(arm.model(), arm.regressor(), s, {}, *motion);
    const auto fit = fit_dynamics(arm.regressor(), arm.base(), *friction, *motion,
                                  {.robust = s.robust, .folds = 3, .trial = true, .threads = 1});
    EXPECT_TRUE(fit) << fit.error().message;
    const auto [first, last] = motion->segments[2];
    return MatrixXd(fit->held_out.middleCols(first, last - first));
  };
  const MatrixXd before = predicted();
  training[2].torque = 1.3 * training[2].torque.array() + 8;
  const MatrixXd difference = predicted() - before;
  double squares = 0, count = 0;
  for (const double x : difference.reshaped())
    if (!std::isnan(x)) squares += x * x, ++count;
  ASSERT_GT(count, 500);
  EXPECT_LT(std::sqrt(squares / count), 0.03);  // Nm: steps end at a tenth of a sigma; of weights by all files 0.35
}

// Steps that are judged by another loss than the one that weights minimise shrink to nothing, and the fit says so.
TEST(RobustFit, EndsAtItsMinimum) {
  Arm arm;
  const std::vector<double> torque_max_nm{100, 50};
  const auto training = arm.recordings({.stribeck_nm = 4, .per_load = 0.1, .ripple = 0.1, .outliers = 0.05}, 80);
  for (const Robust robust : {Robust::huber, Robust::tukey})
    for (const char* law : {"coulomb_viscous", "coulomb_viscous_load"}) {
      const Setting s{.law = *dynamics_law(law, "law"), .robust = robust};
      const auto motion = prepare(training, arm.regressor(), s.signals);
      const auto friction = friction_of(arm.model(), arm.regressor(), s, torque_max_nm, *motion);
      const auto fit = fit_dynamics(arm.regressor(), arm.base(), *friction, *motion, {.robust = robust, .threads = 1});
      ASSERT_TRUE(fit) << fit.error().message;
      EXPECT_THAT(fit->notes, testing::Not(testing::Contains(testing::HasSubstr("still move")))) << law;
    }
}

// Lower cut-offs bridge longer holes; but errors are compared over the same samples.
TEST(Choice, ComparesTheSameSamplesWhereTimeHasHoles) {
  Arm arm;
  const Defects defects{.noise_nm = 3};
  for (const auto& [rate_hz, lost] : {std::pair{125.0, 2}, {500.0, 15}}) {
    RobotRecording whole = arm.recording(defects, 41, 24, rate_hz), r{.file = "holes.csv"};
    std::vector<Index> kept;
    for (Index i = 0; i < whole.position.cols(); ++i)
      if (i % (whole.position.cols() / 4) < whole.position.cols() / 4 - lost) kept.push_back(i);
    for (const Index i : kept) r.time_s.push_back(whole.time_s[static_cast<std::size_t>(i)]);
    r.position = whole.position(Eigen::all, kept), r.torque = whole.torque(Eigen::all, kept);
    const DynamicsChoice choice = arm.choice({r}, {.asymmetry = false, .coupling = true, .lag = true});
    for (const Trial& t : choice.trials)
      if (t.what.starts_with("cut-off ") && t.failure.empty() && !std::isnan(t.change))
        EXPECT_LT(std::abs(t.change), 0.5) << t.what;
    const auto cutoffs = std::ranges::count_if(
        choice.trials, [](const Trial& t) { return t.what.starts_with("cut-off ") && t.failure.empty(); });
    EXPECT_GT(cutoffs, 2) << rate_hz;
  }
}

// A joint that moves for less than the filter takes beside rests: there is nothing to choose by, and that is said.
TEST(Choice, NamesAJointThatMovesTooShortly) {
  Arm arm;
  auto training = arm.recordings({}, 30);
  for (RobotRecording& r : training)
    for (Index i = 0; i < r.position.cols(); ++i) {
      const double share = (r.time_s[static_cast<std::size_t>(i)] - 4) / 0.15;
      r.position(1, i) = share > 0 && share < 1 ? 0.02 * std::pow(std::sin(M_PI * share), 2) : 0;
    }
  const auto choice = choose_dynamics(arm.model(), arm.regressor(), arm.base(), training, {.cutoff_hz = 6},
                                      std::vector{100.0, 50.0}, 2);
  ASSERT_FALSE(choice);
  EXPECT_TRUE(choice.error().message.starts_with("joint elbow moves in 0 of ")) << choice.error().message;
  EXPECT_TRUE(choice.error().message.find("6 Hz") != std::string::npos) << choice.error().message;
}

TEST(HeldOut, HasNoErrorWithoutSamplesOrFinitePredictions) {
  Arm arm;
  const auto motion = prepare(arm.recordings({}, 30), arm.regressor());
  Target target{.motion = *motion, .stretches = {{0, motion->size()}}};
  MatrixXd predicted = motion->torque;
  EXPECT_EQ(errors_of(arm.regressor(), predicted, target)->rms, VectorXd::Zero(2));
  for (Index i = 0; i < motion->size(); ++i)
    if (motion->moving(0, i)) predicted(0, i) = std::nan("");
  const auto errors = errors_of(arm.regressor(), predicted, target);
  ASSERT_FALSE(errors);
  EXPECT_EQ(errors.error().message, "no finite prediction of shoulder");
  target.motion.moving.row(1).setConstant(false);
  const auto fit =
      held_out(arm.regressor(), arm.base(), *robot_friction(arm.model(), arm.regressor(), coulomb_viscous()), *motion,
               {}, target, 3, nullptr, nullptr, 1);
  ASSERT_FALSE(fit);
  EXPECT_THAT(fit.error().message, testing::StartsWith("elbow moves nowhere for long enough"));
}

// Where the torque is not the whole one, no real body explains it, and predicts worse than parameters of none.
TEST(Choice, TakesRealBodiesUnlessTheyPredictWorse) {
  Arm arm;
  const Decided quick{.cutoff_hz = 10,
                      .law = &coulomb_viscous(),
                      .asymmetry = false,
                      .prior = 0,
                      .coupling = true,
                      .lag = true,
                      .robust = Robust::none};
  EXPECT_TRUE(arm.choice(arm.recordings({.noise_nm = 1}, 60), quick).real_bodies);
  const DynamicsChoice choice = arm.choice(arm.recordings({.noise_nm = 1, .fed_forward_kg_m2 = 0.8}, 60), quick);
  EXPECT_FALSE(choice.real_bodies);
  EXPECT_EQ(choice.trials.back().what, "bodies that are real");
  EXPECT_GT(choice.trials.back().change, 0.02);
}

// As of cables or a sensor that turns with the joint: found in its joint alone, and kept by the file.
TEST(Choice, FindsATorqueByPosition) {
  Arm arm;
  const Decided quick{
      .cutoff_hz = 20, .asymmetry = false, .prior = 0, .coupling = true, .lag = true, .robust = Robust::none};
  const auto training = arm.recordings({.by_position_nm = 3}, 60);
  const DynamicsChoice choice = arm.choice(training, quick);
  EXPECT_THAT(choice.setting.by_position, testing::ElementsAre("elbow"));
  const auto motion = prepare(training, arm.regressor(), choice.setting.signals);
  const auto friction = friction_of(arm.model(), arm.regressor(), choice.setting, {}, *motion);
  const auto fit = fit_dynamics(arm.regressor(), arm.base(), *friction, *motion);
  ASSERT_TRUE(fit) << fit.error().message;
  const auto& elbow = fit->friction[1];
  const std::size_t first = elbow.size() - 2;
  EXPECT_EQ(elbow[first].name, "cos_q");
  EXPECT_NEAR(elbow[first].value, 3, 3.5 * elbow[first].sigma);
  EXPECT_NEAR(elbow[first + 1].value, -3, 3.5 * elbow[first + 1].sigma);
  EXPECT_LT(elbow[first + 1].sigma, 0.3);
  const std::string file = testing::TempDir() + "by_position.yaml";
  std::ofstream(file) << to_yaml(
      *fit, arm.base(), *choice.setting.law, arm.regressor(),
      nearest_consistent(arm.regressor(), arm.base(), fit->parameters.base, fit->information), {.model = "arm.xml"});
  const auto read = read_dynamics(file, arm.regressor(), arm.base());
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_THAT(read->by_position, testing::ElementsAre(false, true));
  EXPECT_EQ(read->parameters.friction[1].size(), elbow.size());
  EXPECT_NEAR(read->parameters.friction[1].back(), elbow.back().value, 1e-6);
}

// First moments as the model's make a narrow prior probable, which the elbow's inertia contradicts. It predicts no
// worse than none, as the recording is short, but a wider one much better than both, also what was not recorded.
TEST(Choice, TakesAPriorAsWideAsPredictsWell) {
  Arm arm;
  const Decided quick{.cutoff_hz = 10,
                      .law = &coulomb_viscous(),
                      .asymmetry = false,
                      .rotor_inertia = true,
                      .coupling = true,
                      .lag = true,
                      .robust = Robust::none};
  const Defects defects{.noise_nm = 3, .fed_forward_kg_m2 = 0.5};
  const std::vector<RobotRecording> training{arm.recording(defects, 61, 4)};
  const DynamicsChoice choice = arm.choice(training, quick);
  ASSERT_TRUE(taken(choice, "prior of"));
  EXPECT_GT(choice.setting.prior, 0.5);
  Setting narrow = choice.setting;
  narrow.prior = 0.05;
  const RobotRecording unseen = arm.recording({.noise_nm = 0, .fed_forward_kg_m2 = 0.5}, 90);
  EXPECT_LT(arm.error(choice.setting, training, unseen), 0.8 * arm.error(narrow, training, unseen));
}

TEST(Choice, RemarksASettingThatContainsAnotherAndPredictsWorse) {
  const Setting plain{}, asymmetric{.directional = {.offset = true, .asymmetry = true}},
      load{.law = &coulomb_viscous_load()}, stribeck{.law = friction::find_law("stribeck")};
  const struct {
    const Setting &setting, &narrower;
    Comparison comparison;
    const char* remark;
  } cases[] = {{stribeck, plain, {0.05, 0.02}, "contains coulomb_viscous, yet worse: overfits or did not converge"},
               {load, plain, {0.05, 0.02}, "contains coulomb_viscous, yet worse: overfits or did not converge"},
               {asymmetric,
                plain,
                {0.05, 0.02},
                "contains coulomb_viscous without asymmetry, yet worse: overfits or did not converge"},
               {stribeck, plain, {0.03, 0.02}, ""},
               {stribeck, plain, {-0.05, 0.02}, ""},
               {stribeck, load, {0.05, 0.02}, ""},
               {plain, stribeck, {0.05, 0.02}, ""}};
  for (const auto& c : cases) EXPECT_EQ(remark_of(c.setting, c.narrower, c.comparison), c.remark);
}

TEST(Dynamics, FindsOffsetAndAsymmetryWithinTheirSigmas) {
  Arm arm;
  const auto training = arm.recordings({.offset_nm = 3, .asymmetry = 0.3}, 70);
  const auto friction =
      robot_friction(arm.model(), arm.regressor(), coulomb_viscous(), {.offset = true, .asymmetry = true});
  const auto fit = fit_dynamics(arm.regressor(), arm.base(), *friction, *prepare(training, arm.regressor()));
  ASSERT_TRUE(fit) << fit.error().message;
  for (const auto& joint : fit->friction) {
    ASSERT_THAT(joint, testing::SizeIs(4));
    EXPECT_EQ(joint[2].name, "offset");
    EXPECT_EQ(joint[3].name, "asymmetry");
    const double truth[] = {4, 2, 3, 0.3};
    for (std::size_t p = 0; p < 4; ++p) EXPECT_NEAR(joint[p].value, truth[p], 3.5 * joint[p].sigma) << joint[p].name;
  }
}

// A file without the torque of the elbow adds what its motion does to the shoulder; without any, the elbow is left out.
TEST(Dynamics, UsesTheMotionOfJointsWithoutTorque) {
  Arm arm;
  auto training = arm.recordings({.offset_nm = 3}, 90);
  training[1].without_torque = {false, true};
  training[1].torque.row(1).setZero();
  const auto friction = robot_friction(arm.model(), arm.regressor(), coulomb_viscous());
  const auto some = fit_dynamics(arm.regressor(), arm.base(), *friction, *prepare(training, arm.regressor()));
  ASSERT_TRUE(some) << some.error().message;
  EXPECT_LT(some->joints[1].samples, 0.8 * some->joints[0].samples);
  EXPECT_NEAR(some->friction[1][2].value, 3, 3.5 * some->friction[1][2].sigma);
  for (auto& r : training) r.without_torque = {false, true};
  const auto motion = prepare(training, arm.regressor());
  EXPECT_TRUE(motion->is_left_out(1));
  const auto none = fit_dynamics(arm.regressor(), arm.base(), *friction, *motion);
  ASSERT_TRUE(none) << none.error().message;
  EXPECT_EQ(none->joints[1].samples, 0);
  EXPECT_TRUE(std::isnan(none->friction[1][0].sigma));
  EXPECT_NEAR(none->friction[0][2].value, 3, 3.5 * none->friction[0][2].sigma);
  EXPECT_EQ(arm.choice(training, {.cutoff_hz = 12}).trials.front().rms.size(), 1);
  const auto nonlinear =
      robot_friction(arm.model(), arm.regressor(), **dynamics_law("stribeck", ""), {}, std::vector<double>{100, 1});
  EXPECT_TRUE(fit_dynamics(arm.regressor(), arm.base(), *nonlinear, *motion));
}

// Intervals of 95 % contain the truth in 92 .. 98 % of repeats although noise is correlated and torque ripples by 2 %,
// which nothing models.
TEST(Dynamics, IntervalsHoldUnderCorrelatedNoiseAndRipple) {
  Arm arm;
  const VectorXd truth = arm.base().from_all * arm.regressor().model_parameters();
  const auto friction = robot_friction(arm.model(), arm.regressor(), coulomb_viscous());
  constexpr unsigned repeats = 200;
  double inside = 0, intervals = 0;
  for (unsigned k = 0; k < repeats; ++k) {
    const auto r = arm.recording({.ripple = 0.02, .noise_nm = 0.5, .noise_memory = 0.95}, 1000 + k, 30, 100);
    const auto fit = fit_dynamics(arm.regressor(), arm.base(), *friction, *prepare({&r, 1}, arm.regressor()));
    ASSERT_TRUE(fit) << fit.error().message;
    const auto count = [&](const Estimate& e, double value) {
      if (e.status != Status::estimated) return;
      inside += e.low <= value && value <= e.high, ++intervals;
    };
    for (Index b = 0; b < truth.size(); ++b) count(fit->base[static_cast<std::size_t>(b)], truth(b));
    for (const auto& joint : fit->friction) count(joint[0], 4), count(joint[1], 2), count(joint[2], 0);
  }
  fmt::print("{:.1f} % of {:.0f} intervals\n", 100 * inside / intervals, intervals);
  EXPECT_GT(intervals, 10 * repeats);
  EXPECT_GT(inside / intervals, 0.92);
  EXPECT_LT(inside / intervals, 0.98);
}

// So they do with a prior, where it is true: bodies are the model's as far as it says.
TEST(Dynamics, IntervalsHoldUnderATruePrior) {
  Arm arm;
  const auto friction = robot_friction(arm.model(), arm.regressor(), coulomb_viscous());
  constexpr unsigned repeats = 200;
  for (const double prior : {0.05, 0.2}) {
    double inside = 0, intervals = 0;
    for (unsigned k = 0; k < repeats; ++k) {
      arm.deviate(prior, k);
      const auto r = arm.recording({.noise_nm = 6}, 2000 + k, 8, 100);
      const auto fit =
          fit_dynamics(arm.regressor(), arm.base(), *friction, *prepare({&r, 1}, arm.regressor()), {.prior = prior});
      ASSERT_TRUE(fit) << fit.error().message;
      const VectorXd truth = arm.true_base();
      for (Index b = 0; b < truth.size(); ++b) {
        const Estimate& e = fit->base[static_cast<std::size_t>(b)];
        inside += e.low <= truth(b) && truth(b) <= e.high, ++intervals;
      }
    }
    fmt::print("prior of {}: {:.1f} % of {:.0f} intervals\n", prior, 100 * inside / intervals, intervals);
    EXPECT_GT(inside / intervals, 0.92) << prior;
    EXPECT_LT(inside / intervals, 0.98) << prior;
  }
}

}  // namespace
}  // namespace tribotwin::twin::identification
