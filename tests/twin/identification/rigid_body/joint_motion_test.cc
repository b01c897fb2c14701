// An axis of known inertia and friction, filtered: turns, rests and ends of its record leave no error in the
// parameters.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>
#include <tribotwin/twin/numerics/filter.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd;

constexpr double mass_kg = 12, coulomb_n = 40, viscous_n_s_m = 15;

struct Instant {
  double x, v, a;
};

struct Noise {
  double force_n = 0.4, step_m = 1e-6, encoder_m = 0;
};

class Axis {
 public:
  const Regressor& regressor() const { return regressor_; }

  /// `motion` at a time [s]; at rest it sticks anywhere between both directions of friction.
  template <class Motion>
  RobotRecording recording(const Motion& motion, const Noise& n, unsigned seed, double length_s = 8,
                           double rate_hz = 500) const {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    RobotRecording r{.file = "axis.csv"};
    const auto samples = static_cast<Index>(length_s * rate_hz);
    r.position.resize(1, samples), r.torque.resize(1, samples);
    for (Index i = 0; i < samples; ++i) {
      const double t = static_cast<double>(i) / rate_hz;
      const Instant now = motion(t);
      const double friction =
          now.v == 0 ? coulomb_n * std::sin(2.7 * t) : std::copysign(coulomb_n, now.v) + viscous_n_s_m * now.v;
      r.time_s.push_back(t);
      r.position(0, i) = n.step_m * std::round((now.x + n.encoder_m * normal(random)) / n.step_m);
      r.torque(0, i) = mass_kg * now.a + friction + n.force_n * normal(random);
    }
    return r;
  }

  DynamicsFit fit(const JointMotion& motion) const {
    auto out = fit_dynamics(regressor_, base_, friction_, motion);
    EXPECT_TRUE(out) << out.error().message;
    return *out;
  }

  MatrixXd error_of_truth(const JointMotion& motion) const {
    return motion.torque -
           predicted_torque(
               regressor_, base_, friction_,
               {.base = Eigen::VectorXd::Constant(1, mass_kg), .friction = {{coulomb_n, viscous_n_s_m, 0}}}, motion, 1);
  }

 private:
  std::shared_ptr<const mujoco::Model> model_ = *mujoco::load_string(R"(<mujoco><worldbody><body>
    <joint name="axis" type="slide" axis="1 0 0"/><geom size=".1" mass="10"/></body></worldbody></mujoco>)");
  Regressor regressor_ = *Regressor::create(model_->get());
  BaseParameters base_ = base_parameters(regressor_);
  RobotFriction friction_ = *robot_friction(*model_, regressor_, coulomb_viscous());
};

/// Sum of sines, faster by `pace`.
struct Sines {
  double pace;
  double phase[3];

  Sines(double pace_of_all, unsigned seed) : pace(pace_of_all) {
    std::mt19937_64 random(seed);
    for (double& p : phase) p = std::uniform_real_distribution<double>(0, 2 * M_PI)(random);
  }
  Instant operator()(double t) const {
    Instant now{0, 0, 0};
    for (int k = 0; k < 3; ++k) {
      const double w = 2 * M_PI * pace * (0.31 + 0.23 * k), a = 0.3 / (1 + k) / pace, x = w * t + phase[k];
      now.x += a * std::sin(x), now.v += a * w * std::cos(x), now.a -= a * w * w * std::sin(x);
    }
    return now;
  }
};

/// Back and forth by 0.3 m in 0.5 s, then a rest of 0.5 s.
Instant with_rests(double t) {
  const double cycle = std::fmod(t, 2), s = std::min(1.0, std::fmod(cycle, 1) / 0.5), T = 0.5;
  const double sign = cycle < 1 ? 1 : -1, from = cycle < 1 ? 0 : 0.3;
  if (s == 0 || s == 1) return {from + sign * 0.3 * s, 0, 0};
  return {from + sign * 0.3 * s * s * s * (10 + s * (-15 + 6 * s)), sign * 0.3 * 30 * s * s * (1 - s) * (1 - s) / T,
          sign * 0.3 * 60 * s * (1 - s) * (1 - 2 * s) / (T * T)};
}

/// Within the sigmas, or a two-hundredth: what turns with the filtered speed turns a little beside the speed.
void expect_truth(const DynamicsFit& fit, const char* where) {
  const auto near = [&](const Estimate& e, double truth, double size) {
    EXPECT_NEAR(e.value, truth, std::max(4 * e.sigma, 0.005 * size)) << where << e.name;
  };
  near(fit.base[0], mass_kg, mass_kg);
  near(fit.friction[0][0], coulomb_n, coulomb_n);
  near(fit.friction[0][1], viscous_n_s_m, viscous_n_s_m);
  near(fit.friction[0][2], 0, coulomb_n);
  EXPECT_LT(fit.friction[0][0].sigma, 0.03 * coulomb_n) << where;
}

TEST(JointMotion, TurnsBiasNothingAndAreKept) {
  const Axis axis;
  for (const auto& [pace, cutoff_hz] : {std::pair{1.0, 20.0}, {1.0, 5.0}, {4.0, 20.0}, {4.0, 10.0}}) {
    const auto r = axis.recording(Sines(pace, 5), {}, 7);
    const auto motion = prepare({&r, 1}, axis.regressor(), {.cutoff_hz = cutoff_hz, .reversals = true});
    ASSERT_TRUE(motion) << motion.error().message;
    const auto where = fmt::format("pace {}, {} Hz: ", pace, cutoff_hz);
    EXPECT_GT(motion->moving.cast<double>().mean(), 0.9) << where;
    expect_truth(axis.fit(*motion), where.c_str());
  }
}

// A lead moves the turns of the friction and nothing else; where rows beside turns are left out there is none.
TEST(JointMotion, FrictionMayTurnBeforeTheSpeed) {
  const Axis axis;
  const auto r = axis.recording(Sines(1, 5), {}, 7);
  const Preparation as_the_speed{.cutoff_hz = 10, .decimation = 1, .reversals = true};
  Preparation before = as_the_speed, without = as_the_speed;
  constexpr Index samples = 6;
  before.turn_lead_s = samples * (r.time_s[1] - r.time_s[0]);
  const auto a = prepare({&r, 1}, axis.regressor(), as_the_speed), b = prepare({&r, 1}, axis.regressor(), before);
  ASSERT_TRUE(a && b);
  const Index n = a->size() - samples;
  EXPECT_LT((b->direction.leftCols(n) - a->direction.rightCols(n)).cwiseAbs().maxCoeff(), 1e-9);
  EXPECT_GT((b->direction - a->direction).cwiseAbs().maxCoeff(), 0.1);
  EXPECT_EQ(a->qd, b->qd);
  EXPECT_EQ(a->torque, b->torque);
  EXPECT_EQ(a->moving, b->moving);
  without.reversals = before.reversals = false;
  EXPECT_EQ(prepare({&r, 1}, axis.regressor(), without)->direction,
            prepare({&r, 1}, axis.regressor(), before)->direction);
}

// Rows that are kept may be far apart: a turn between two of them is as near as one in them.
TEST(JointMotion, TurnsBetweenKeptSamplesAreLeftOut) {
  const Axis axis;
  const Sines motion(1, 5);
  const auto r = axis.recording(motion, {}, 7, 60);
  for (const unsigned decimation : {0u, 37u}) {
    const auto prepared = prepare({&r, 1}, axis.regressor(), {.decimation = decimation});
    ASSERT_TRUE(prepared) << prepared.error().message;
    for (Index i = 0; i < prepared->size(); ++i) {
      constexpr double beside_s = 0.095;  // two periods of 20 Hz
      const double t = prepared->time_s[static_cast<std::size_t>(i)];
      if (motion(t - beside_s).v * motion(t + beside_s).v < 0) EXPECT_FALSE(prepared->moving(0, i)) << t;
    }
    EXPECT_GT(prepared->moving.count(), prepared->size() / 3) << decimation;
    EXPECT_FALSE(prepared->reversals);
    expect_truth(axis.fit(*prepared), "turns ");
  }
}

// Where hardly a sample is far from turns, those near them count, and it is said.
TEST(JointMotion, QuickTurnsCount) {
  const Axis axis;
  const auto r = axis.recording(Sines(15, 5), {}, 7, 30);
  const auto prepared = prepare({&r, 1}, axis.regressor());
  ASSERT_TRUE(prepared) << prepared.error().message;
  EXPECT_TRUE(prepared->reversals);
  EXPECT_THAT(prepared->notes, testing::Contains(testing::HasSubstr("joint axis turns so often that ")));
  expect_truth(axis.fit(*prepared), "quick turns ");
}

// Torques are filtered, speeds and accelerations filtered and differentiated: by what is as large as what was filtered.
TEST(JointMotion, SlowSamplingBiasesNothing) {
  const Axis axis;
  const Sines motion(4, 6);
  for (const bool recorded : {false, true}) {
    auto r = axis.recording(motion, {.force_n = 0.1}, 3, 60, 50);
    if (recorded) {
      r.velocity.resize(1, r.position.cols());
      for (Index i = 0; i < r.position.cols(); ++i) r.velocity(0, i) = motion(r.time_s[static_cast<std::size_t>(i)]).v;
    }
    const auto prepared = prepare({&r, 1}, axis.regressor(), {.recorded_velocity = recorded, .reversals = true});
    ASSERT_TRUE(prepared) << prepared.error().message;
    const auto fit = axis.fit(*prepared);
    EXPECT_NEAR(fit.base[0].value, mass_kg, 0.001 * mass_kg) << recorded;
    expect_truth(fit, "slow sampling ");
  }
}

TEST(Derivatives, AreThoseOfASineUpToAFifthOfItsSampling) {
  constexpr double rate_hz = 200;
  for (const double hz : {1.0, 10.0, 40.0}) {
    const double w = 2 * M_PI * hz;
    std::vector<double> sine;
    for (int i = 0; i < 400; ++i) sine.push_back(std::sin(w * i / rate_hz + 0.3));
    const auto first = first_derivative(sine, rate_hz), second = second_derivative(sine, rate_hz);
    for (int i = 8; i < 392; ++i) {
      const auto at = static_cast<std::size_t>(i);
      EXPECT_NEAR(first[at] / w, std::cos(w * i / rate_hz + 0.3), 1e-4);
      EXPECT_NEAR(second[at] / (w * w), -sine[at], 1e-4);
    }
  }
  const std::vector<double> parabola{0, 1, 4, 9, 16};
  EXPECT_THAT(first_derivative(parabola, 1), testing::ElementsAre(2, 2, 4, 6, 6));
  EXPECT_THAT(second_derivative(parabola, 1), testing::Each(testing::DoubleNear(2, 1e-12)));
}

struct Table {
  std::shared_ptr<const mujoco::Model> model;
  Regressor regressor;

  explicit Table(const char* limits)
      : model(*mujoco::load_string(fmt::format(R"(<mujoco><compiler angle="radian"/><worldbody><body>
          <joint name="table" axis="0 0 1" {}/><geom size=".1" pos=".3 0 0" mass="3"/></body></worldbody></mujoco>)",
                                               limits))),
        regressor(*Regressor::create(model->get())) {}

  /// `angle` at each time [s].
  Result<RobotRecording> read(const std::vector<double>& time_s, const std::function<double(double)>& angle) const {
    const auto file = std::filesystem::path(testing::TempDir()) / "turns.csv";
    {
      std::ofstream out(file);
      out << "time_s,position_table_rad,torque_table_nm\n";
      for (std::size_t i = 0; i < time_s.size(); ++i)
        out << fmt::format("{},{:.9f},{}\n", time_s[i], angle(time_s[i]), i % 7);
    }
    return read_robot_recording(file, regressor);
  }
};

TEST(RobotRecording, AnglesWithinATurnGoOn) {
  std::vector<double> time_s;
  for (int i = 0; i < 2500; ++i) time_s.push_back(i / 250.0);
  const auto angle = [](double t) { return 9 * std::sin(0.8 * t) + 0.2 * t; };
  const auto read = Table("").read(time_s, [&](double t) { return std::remainder(angle(t), 2 * M_PI); });
  ASSERT_TRUE(read) << read.error().message;
  for (Index i = 0; i < read->position.cols(); ++i)
    ASSERT_NEAR(read->position(0, i), angle(read->time_s[static_cast<std::size_t>(i)]), 1e-6);
  EXPECT_THAT(read->notes, testing::Contains(testing::HasSubstr("position_table_rad jumps by a turn ")));
}

// Across a gap in time a joint may be anywhere, and one with narrow limits is where it says.
TEST(RobotRecording, AnglesOfOtherPlacesStay) {
  std::vector<double> time_s;
  for (int i = 0; i < 500; ++i) time_s.push_back(i / 100.0 + (i < 250 ? 0 : 20));
  const auto two_places = [](double t) { return (t < 10 ? -2.5 : 2.5) + 0.3 * std::sin(t); };
  const auto jump = [](double t) { return (t < 2 ? -2.5 : 2.5) + 0.3 * std::sin(t); };
  for (const auto& read :
       {Table("").read(time_s, two_places), Table(R"(range="-2.9 2.9" limited="true")").read(time_s, jump)}) {
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_THAT(read->notes, testing::Not(testing::Contains(testing::HasSubstr("jumps by a turn"))));
    EXPECT_GT(read->position.maxCoeff(), 2.4);
  }
}

TEST(JointMotion, RestsAreLeftOutAndNoiseIsNoMotion) {
  const Axis axis;
  for (const Noise& noise : {Noise{}, Noise{.step_m = 2e-4, .encoder_m = 1e-4}}) {
    const auto r = axis.recording(with_rests, noise, 3);
    const auto motion = prepare({&r, 1}, axis.regressor(), {.cutoff_hz = 20, .reversals = true});
    ASSERT_TRUE(motion) << motion.error().message;
    Index moving = 0;
    for (Index i = 0; i < motion->size(); ++i) {
      const double time = motion->time_s[static_cast<std::size_t>(i)], t = std::fmod(time, 1);
      if (time > 0.5 && (t < 0.05 || t > 0.45))
        EXPECT_FALSE(motion->moving(0, i)) << t;  // a period of 20 Hz; no rest comes before the first motion
      moving += motion->moving(0, i);
    }
    EXPECT_GT(moving, motion->size() / 8);
    expect_truth(axis.fit(*motion), noise.encoder_m > 0 ? "coarse encoder: " : "");
  }
}

// A velocity of its own that is late: its delay is found within its sigmas whatever the noise of the encoder, removed
// and said.
// What is left of a joint that stands still is noise: predicted is the friction of those that move.
TEST(JointMotion, AJointThatStandsStillMayWhereItIsSaid) {
  const Axis axis;
  const auto still = axis.recording([](double) { return Instant{0.3, 0, 0}; }, {.encoder_m = 1e-6}, 7);
  const auto refused = prepare({&still, 1}, axis.regressor());
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, testing::HasSubstr("stands still in all recordings"));
  const auto motion = prepare({&still, 1}, axis.regressor(), {.still_joints = true});
  ASSERT_TRUE(motion) << motion.error().message;
  EXPECT_FALSE(motion->moving.any());
}

TEST(JointMotion, RecordedVelocitiesThatAreLateAreMovedAndSaid) {
  const Axis axis;
  constexpr double delay_s = 0.0042;
  int held = 0;
  for (int k = 0; k < 40; ++k) {
    const Sines motion(1, 5 + static_cast<unsigned>(k));
    auto r = axis.recording(motion, {.step_m = 1e-4, .encoder_m = 2e-4}, static_cast<unsigned>(k));
    std::mt19937_64 random(static_cast<unsigned>(k));
    std::normal_distribution<double> normal;
    r.velocity.resize(1, r.position.cols());
    for (Index i = 0; i < r.position.cols(); ++i)
      r.velocity(0, i) = motion(r.time_s[static_cast<std::size_t>(i)] - delay_s).v + 2e-3 * normal(random);
    const auto moved = prepare({&r, 1}, axis.regressor(), {.cutoff_hz = 20, .recorded_velocity = true});
    ASSERT_TRUE(moved) << moved.error().message;
    ASSERT_EQ(moved->velocity_delay.size(), 1u);
    const auto& found = moved->velocity_delay[0];
    EXPECT_LT(found.sigma_s, 3e-4);
    EXPECT_TRUE(found.removed);
    EXPECT_THAT(
        moved->notes,
        testing::Contains(testing::HasSubstr("late against the slope of their positions (negative: early): axis ")));
    held += std::abs(found.value_s - delay_s) < 1.96 * found.sigma_s;
    double squares = 0;
    for (Index i = 0; i < moved->size(); ++i)
      squares += std::pow(moved->qd(0, i) - motion(moved->time_s[static_cast<std::size_t>(i)]).v, 2);
    EXPECT_LT(std::sqrt(squares / static_cast<double>(moved->size())), 1.5e-3);  // the delay alone makes 4e-3
  }
  EXPECT_GE(held, 35);
}

TEST(JointMotion, RecordedVelocitiesOnTimeStay) {
  const Axis axis;
  const Sines motion(1, 5);
  auto r = axis.recording(motion, {.step_m = 1e-4}, 7);
  r.velocity.resize(1, r.position.cols());
  for (Index i = 0; i < r.position.cols(); ++i) r.velocity(0, i) = motion(r.time_s[static_cast<std::size_t>(i)]).v;
  const auto motion_of_it = prepare({&r, 1}, axis.regressor(), {.cutoff_hz = 20, .recorded_velocity = true});
  ASSERT_TRUE(motion_of_it) << motion_of_it.error().message;
  EXPECT_FALSE(motion_of_it->velocity_delay[0].removed);
  EXPECT_THAT(motion_of_it->notes, testing::Not(testing::Contains(testing::HasSubstr("late against"))));
}

// At a recorded standstill friction is not known, but what does not depend on speed acts.
TEST(RobotTorque, AtRestOffsetAndTorqueByPositionStay) {
  const auto model = *mujoco::load_string(R"(<mujoco><worldbody><body>
    <joint name="hinge" axis="0 0 1"/><geom size=".1" pos=".3 0 0" mass="3"/></body></worldbody></mujoco>)");
  const Regressor regressor = *Regressor::create(model->get());
  const BaseParameters base = base_parameters(regressor);
  RobotFriction friction = *robot_friction(*model, regressor, coulomb_viscous());
  friction[0].depend_on_position();
  JointMotion motion;
  motion.q = MatrixXd::Constant(1, 2, 0.4), motion.qd = MatrixXd{{0, 1e-9}};
  motion.qdd = MatrixXd::Zero(1, 2), motion.direction = MatrixXd{{0, 0}};
  motion.temperature_degC = MatrixXd::Constant(1, 2, 20);
  const MatrixXd torque =
      predicted_torque(regressor, base, friction,
                       {.base = Eigen::VectorXd::Zero(base.size()), .friction = {{5, 2, 0.7, 3, -2}}}, motion, 1);
  const double rest_nm = 0.7 + 3 * std::cos(0.4) - 2 * std::sin(0.4);
  EXPECT_NEAR(torque(0, 0), rest_nm, 1e-12);
  EXPECT_NEAR(torque(0, 1), rest_nm, 1e-6);  // as beside it, where the filtered direction is 0
}

// A user compares predictions with what was recorded at the same times.
TEST(JointMotion, TorquesGoBackToTheTimesOfTheirRecording) {
  const Axis axis;
  const Preparation on_time{.cutoff_hz = 20, .decimation = 1};
  for (const double lag_s : {0.0133, -0.0071}) {
    Preparation without_lag = on_time;
    without_lag.lag_s = {lag_s};
    const auto recording = axis.recording(Sines(1, 4), {}, 5);
    const JointMotion recorded = *prepare({&recording, 1}, axis.regressor(), on_time),
                      advanced = *prepare({&recording, 1}, axis.regressor(), without_lag);
    const AsRecorded back = as_recorded(advanced, advanced.torque);
    ASSERT_EQ(recorded.time_s, advanced.time_s);
    const auto known = std::ranges::count(back.known, true);
    EXPECT_NEAR(static_cast<double>(known), static_cast<double>(advanced.size()) - 500 * std::abs(lag_s), 1);
    EXPECT_EQ(back.known.front(), lag_s < 0);
    EXPECT_EQ(back.known.back(), lag_s > 0);
    for (Index i = 2; i + 2 < advanced.size(); ++i) {
      if (!back.known[static_cast<std::size_t>(i)] || !back.known[static_cast<std::size_t>(lag_s > 0 ? i - 2 : i + 2)])
        continue;
      EXPECT_NEAR(back.torque(0, i), recorded.torque(0, i), 0.01 * coulomb_n) << lag_s << ' ' << i;
    }
    EXPECT_GT((advanced.torque - recorded.torque).cwiseAbs().maxCoeff(), 0.1 * coulomb_n);
  }
}

TEST(JointMotion, TorquesWithoutLagStayAsTheyAre) {
  const Axis axis;
  const auto recording = axis.recording(Sines(1, 4), {}, 5);
  const JointMotion motion = *prepare({&recording, 1}, axis.regressor(), {});
  const AsRecorded same = as_recorded(motion, motion.torque);
  EXPECT_EQ(same.torque, motion.torque);
  EXPECT_TRUE(std::ranges::all_of(same.known, std::identity{}));
}

// Torques of one fit are filtered alike, and preparing them again with the cut-off that was found is possible.
TEST(JointMotion, WithoutACutoffFilesOfDifferentRatesShareThatOfTheSlowest) {
  const Axis axis;
  const std::vector<RobotRecording> recordings = {axis.recording(Sines(1, 4), {}, 5, 20, 32.5),
                                                  axis.recording(Sines(1, 6), {}, 7, 20, 11.83)};
  const auto mixed = prepare(recordings, axis.regressor(), {});
  ASSERT_TRUE(mixed) << mixed.error().message;
  EXPECT_NEAR(mixed->cutoff_hz, 11.83 / 5, 1e-6);
  EXPECT_THAT(mixed->notes, testing::Contains(testing::HasSubstr("is sampled at 11.83 Hz")));
  const auto again = prepare(recordings, axis.regressor(), {.cutoff_hz = mixed->cutoff_hz});
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(again->torque, mixed->torque);
}

TEST(JointMotion, FilesWhoseRatesOnlyJitterKeepTheirCutoffs) {
  const Axis axis;
  const RobotRecording slow = axis.recording(Sines(1, 4), {}, 5, 8, 49.9),
                       fast = axis.recording(Sines(1, 6), {}, 7, 8, 50);
  const auto both = prepare(std::vector{fast, slow}, axis.regressor(), {});
  ASSERT_TRUE(both) << both.error().message;
  EXPECT_NEAR(both->cutoff_hz, 10, 1e-9);
  EXPECT_THAT(both->notes, testing::IsEmpty());
}

}  // namespace
}  // namespace tribotwin::twin::identification
