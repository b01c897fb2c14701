#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <random>
#include <sstream>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/twin/experiments/friction/curve_rows.hpp>
#include <tribotwin/twin/experiments/friction/results.hpp>
#include <tribotwin/twin/experiments/friction/warmup.hpp>
#include <tribotwin/twin/identification/samples/levels.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/tables/table.hpp>

namespace tribotwin::twin {
namespace {

using testing::HasSubstr;

/// A robot joint that is no twin: trapezoids that settle, friction of a formula, gravity of a pendulum.
struct Synthetic {
  std::vector<double> speeds{0.01, 0.05, 0.2, 0.5, 1, 1.5};
  double start_rad = -0.8, travel_s = 2, min_travel_rad = 0, turn_s = 0.3;
  double gravity_nm = 400, offset_nm = 50, inertia_kg_m2 = 30;
  double forward_nm = 100, backward_nm = 100, viscous = 40, stribeck = 30;
  double ripple = 0;  ///< of the speed, relative, at 6 Hz
  double noise_nm = 0, correlation = 0;
  Sensors sensors{.sampling_hz = 250};
  bool load = false, reverse = true;
  std::uint64_t seed = 1;

  double friction(double v) const {
    return (v > 0 ? forward_nm : backward_nm) + viscous * std::abs(v) + stribeck * std::exp(-std::abs(v) / 0.05);
  }
  double gravity(double q) const { return offset_nm + gravity_nm * std::sin(q); }

  JointRecording signals() const {
    JointRecording r;
    const double dt = 1e-3;
    double q = start_rad, v = 0, a = 0, t = 0;
    const auto go = [&](double speed, double seconds) {
      for (double end = t + seconds; t < end; t += dt) {
        const double target = speed * (1 + ripple * std::sin(2 * std::numbers::pi * 6 * t));
        a += (900 * (target - v) - 60 * a) * dt;  // critically damped at 30 rad/s
        r.time_s.push_back(t);
        r.position_rad.push_back(q);
        r.velocity_rad_s.push_back(v);
        const double f = std::abs(v) < 1e-4 ? 0 : std::copysign(friction(v), v);
        r.torque_nm.push_back(gravity(q) + f + inertia_kg_m2 * a);
        if (load) r.load_nm.push_back(gravity(q));
        r.temperature_degC.push_back(40 + t / 60);
        v += a * dt;
        q += v * dt;
      }
    };
    go(0, 0.5);
    for (const double s : speeds) {
      const double seconds = std::max(travel_s, min_travel_rad / s);
      go(s, seconds);
      go(0, turn_s);
      if (reverse) go(-s, seconds), go(0, turn_s);
    }
    return r;
  }
  JointRecording recording() const {
    JointRecording r = sensed(signals(), sensors, seed);
    std::mt19937_64 random(seed + 99);
    std::normal_distribution<double> normal;
    double e = normal(random);
    for (double& u : r.torque_nm) {
      u += noise_nm * e;
      e = correlation * e + std::sqrt(1 - correlation * correlation) * normal(random);
    }
    return r;
  }
};

TEST(Levels, FindsFrictionUnderGravity) {
  const Synthetic robot;
  const auto found = levels_of(robot.recording());
  ASSERT_TRUE(found) << found.error().message;
  ASSERT_EQ(found->levels.size(), robot.speeds.size());
  for (std::size_t i = 0; i < robot.speeds.size(); ++i) {
    const Level& level = found->levels[i];
    EXPECT_NEAR(level.speed_rad_s, robot.speeds[i], 1e-3 * robot.speeds[i]);
    EXPECT_NEAR(level.friction_nm, robot.friction(robot.speeds[i]), 2e-3 * robot.friction(robot.speeds[i]))
        << robot.speeds[i];
    EXPECT_FALSE(level.forward);
    EXPECT_LT(level.end_s - level.begin_s, 2 * robot.travel_s + 1);
    EXPECT_NEAR(level.temperature_degC, 40 + 0.5 * (level.begin_s + level.end_s) / 60, 0.01);
  }
  EXPECT_NEAR(found->lag_s, 0, 0.001);
}

TEST(Levels, TakesOutTheLagOfTheTorque) {
  for (const double lag : {0.004, 0.013, 0.05}) {
    Synthetic robot{.noise_nm = 5, .sensors = {.sampling_hz = 250, .lag_s = lag}};
    const auto found = levels_of(robot.recording());
    ASSERT_TRUE(found) << found.error().message;
    EXPECT_NEAR(found->lag_s, lag, 0.004);
    EXPECT_GT(found->lag_stderr_s, 0);
    for (const Level& level : found->levels)
      EXPECT_NEAR(level.friction_nm, robot.friction(level.speed_rad_s), 4 * level.stderr_nm + 1e-3 * level.friction_nm)
          << lag << " s, " << level.speed_rad_s;
    // Left in, it costs more than that at the fastest level.
    const auto late = levels_of(robot.recording(), {.lag_s = 0});
    EXPECT_GT(std::abs(late->levels.back().friction_nm - robot.friction(1.5)),
              std::abs(found->levels.back().friction_nm - robot.friction(1.5)));
    EXPECT_GT(std::abs(late->levels.back().friction_nm - robot.friction(1.5)), 300 * lag);
  }
}

TEST(Levels, TellsTheDirectionsApartWhereTheLoadIsKnown) {
  Synthetic robot{.forward_nm = 120, .backward_nm = 90, .load = true};
  const auto found = levels_of(robot.recording());
  ASSERT_TRUE(found) << found.error().message;
  for (const Level& level : found->levels) {
    EXPECT_NEAR(level.forward->friction_nm, robot.friction(level.speed_rad_s), 0.3);
    EXPECT_NEAR(level.backward->friction_nm, robot.friction(-level.speed_rad_s), 0.3);
    EXPECT_NEAR(level.friction_nm, 0.5 * (robot.friction(level.speed_rad_s) + robot.friction(-level.speed_rad_s)), 0.3);
  }
}

TEST(Levels, MeasuresWhereItIsTold) {
  Synthetic robot{.min_travel_rad = 1.5, .load = true};
  robot.speeds = {0.2, 0.5, 1};
  const auto found = levels_of(robot.recording(), {.speeds_rad_s = {1, 0.2}, .centre_rad = 0.2, .width_rad = 0.1});
  ASSERT_TRUE(found) << found.error().message;
  ASSERT_EQ(found->levels.size(), 2);  // in the order asked for
  for (const Level& level : found->levels) {
    EXPECT_NEAR(level.load_nm, robot.gravity(0.2), 1.5);
    EXPECT_NEAR(level.friction_nm, robot.friction(level.speed_rad_s), 0.3);
  }
  EXPECT_THAT(levels_of(robot.recording(), {.speeds_rad_s = {1}, .centre_rad = 2, .width_rad = 0.1}).error().message,
              HasSubstr("of 2 +- 0.05 rad"));
}

/// What makes segmentation hard; friction must still be right within its standard error.
struct Hard {
  const char* name;
  Synthetic robot;
  friend void PrintTo(const Hard& h, std::ostream* out) { *out << h.name; }
};
class HardLevels : public testing::TestWithParam<Hard> {};
TEST_P(HardLevels, AreFound) {
  const Synthetic& robot = GetParam().robot;
  const auto found = levels_of(robot.recording(), {.speeds_rad_s = robot.speeds});
  ASSERT_TRUE(found) << found.error().message;
  for (const Level& level : found->levels) {
    EXPECT_NEAR(level.friction_nm, robot.friction(level.speed_rad_s), 4 * level.stderr_nm + 2e-3 * level.friction_nm)
        << level.speed_rad_s << " rad/s, stderr " << level.stderr_nm << ", " << level.samples;
    EXPECT_EQ(level.ripple_nm, 0) << level.speed_rad_s << " rad/s: none of these has a ripple over the angle";
  }
}
INSTANTIATE_TEST_SUITE_P(
    Cases, HardLevels,
    testing::Values(
        Hard{"fine_encoder", {.noise_nm = 5, .sensors = {.encoder_increments_per_turn = 729088, .sampling_hz = 250}}},
        Hard{"coarse_encoder",
             {.min_travel_rad = 0.15,
              .noise_nm = 5,
              .sensors = {.encoder_increments_per_turn = 4096, .sampling_hz = 250}}},
        Hard{"fast_sampling",
             {.noise_nm = 10, .sensors = {.encoder_increments_per_turn = 100000, .sampling_hz = 1000}}},
        Hard{"slow_sampling",
             {.travel_s = 3, .noise_nm = 2, .sensors = {.encoder_increments_per_turn = 100000, .sampling_hz = 50}}},
        Hard{"speed_ripple", {.ripple = 0.01, .noise_nm = 5}},
        Hard{"short_passes", {.travel_s = 0.9, .turn_s = 0.05, .noise_nm = 5}},
        Hard{"no_turns", {.turn_s = 0, .noise_nm = 5}},
        Hard{"all_at_once",
             {.min_travel_rad = 0.1,
              .ripple = 0.005,
              .noise_nm = 20,
              .sensors = {.encoder_increments_per_turn = 65536, .sampling_hz = 250, .lag_s = 0.02}}},
        Hard{"no_gravity", {.gravity_nm = 0, .noise_nm = 5, .sensors = {.sampling_hz = 250, .lag_s = 0.02}}},
        Hard{"crawling",
             {.speeds = {0.001, 0.002, 0.5},
              .travel_s = 4,
              .noise_nm = 1,
              .sensors = {.encoder_increments_per_turn = 1e6, .sampling_hz = 250}}}),
    [](const auto& info) { return info.param.name; });

/// (found - true) / standard error over many levels.
double spread_of_scores(double correlation, double lag_s) {
  double square = 0, count = 0;
  for (std::uint64_t seed = 0; seed < 80; ++seed) {
    const Synthetic robot{.noise_nm = 8,
                          .correlation = correlation,
                          .sensors = {.encoder_increments_per_turn = 729088, .sampling_hz = 250, .lag_s = lag_s},
                          .seed = seed};
    const auto found = levels_of(robot.recording(), {.speeds_rad_s = robot.speeds});
    if (!found) {
      ADD_FAILURE() << found.error().message;
      return 0;
    }
    for (const Level& level : found->levels) {
      square += std::pow((level.friction_nm - robot.friction(level.speed_rad_s)) / level.stderr_nm, 2);
      ++count;
    }
  }
  EXPECT_GE(count, 400);
  return std::sqrt(square / count);
}

TEST(Levels, StandardErrorsAreCalibrated) {
  for (const double correlation : {0.0, 0.5})
    for (const double lag : {0.0, 0.012}) {
      const double spread = spread_of_scores(correlation, lag);
      fmt::print("correlation {}, lag {} s: spread of scores {:.3f}\n", correlation, lag, spread);
      EXPECT_GT(spread, 0.8) << correlation << ' ' << lag;
      EXPECT_LT(spread, 1.2) << correlation << ' ' << lag;
    }
}

TEST(Levels, RepeatedCyclesStayApart) {
  Synthetic robot{.min_travel_rad = 0};
  robot.speeds = {0.5, 1, 0.5, 1, 0.5, 1};
  const auto found = levels_of(robot.recording());
  ASSERT_TRUE(found) << found.error().message;
  ASSERT_EQ(found->levels.size(), 6);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_NEAR(found->levels[i].speed_rad_s, robot.speeds[i], 1e-3);
    if (i) EXPECT_GT(found->levels[i].begin_s, found->levels[i - 1].end_s);
  }
}

TEST(Levels, OffsetIsPaperTwos) {
  // The reverse pass starts short of where the forward one ended: by 0.1 rad, 0.1 s at 1 rad/s.
  JointRecording r;
  double q = 0;
  const auto go = [&](double v, double seconds) {
    for (int k = 0; k < seconds * 250; ++k) {
      r.time_s.push_back(static_cast<double>(r.size()) / 250);
      r.position_rad.push_back(q);
      r.torque_nm.push_back(v > 0 ? 30 : v < 0 ? -30 : 0);
      q += v / 250;
    }
  };
  go(1, 1), go(0, 0.2), go(-2, 0.05), go(0, 0.2), go(-1, 1);
  const auto found = levels_of(r);
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_NEAR(found->levels.at(0).offset_s, 0.1, 0.02);
  EXPECT_NEAR(found->levels.at(0).friction_nm, 30, 1e-6);
}

TEST(Levels, SayWhatIsMissing) {
  Synthetic robot{.reverse = false};
  robot.speeds = {0.42};
  EXPECT_THAT(levels_of(robot.recording()).error().message, HasSubstr("no reverse pass at 0.42 rad/s"));
  EXPECT_THAT(levels_of(robot.recording(), {.speeds_rad_s = {0.42}}).error().message,
              HasSubstr("no reverse pass at 0.42 rad/s"));
  robot.reverse = true;
  EXPECT_THAT(levels_of(robot.recording(), {.speeds_rad_s = {0.42, 0.9}}).error().message,
              HasSubstr("no pass at 0.9 rad/s"));
  EXPECT_THAT(levels_of({}).error().message, HasSubstr("empty"));

  JointRecording r = robot.recording();
  r.torque_nm.pop_back();
  EXPECT_THAT(levels_of(r).error().message, HasSubstr("torque_nm has"));
  r = robot.recording();
  r.position_rad[7] = std::nan("");
  EXPECT_THAT(levels_of(r).error().message, HasSubstr("position_rad is not finite at sample 7"));
  r = robot.recording();
  std::swap(r.time_s[10], r.time_s[11]);
  EXPECT_THAT(levels_of(r).error().message, HasSubstr("at sample 11 does not come after"));
  r = robot.recording();
  for (double& v : r.velocity_rad_s) v *= 180 / std::numbers::pi;
  EXPECT_THAT(levels_of(r).error().message, HasSubstr("57.3 times as fast"));
}

TEST(Levels, AreNotFoundInAnExcitationTrajectory) {
  JointRecording r;
  for (int k = 0; k < 5000; ++k) {
    const double t = k / 250.0;
    r.time_s.push_back(t);
    r.position_rad.push_back(0.8 * std::sin(2 * t) + 0.3 * std::cos(5 * t));
    r.torque_nm.push_back(1);
  }
  EXPECT_FALSE(levels_of(r));
}

TEST(Levels, SurviveAnyNumbers) {
  std::mt19937_64 random(5);
  for (int trial = 0; trial < 300; ++trial) {
    Synthetic robot{.travel_s = 0.5, .noise_nm = 5};
    robot.speeds = {0.3, 1};
    JointRecording r = robot.recording();
    // Cut, thin out, spike and shift: a result or an error message, never a crash or a number that is not finite.
    for (int k = 0; k < 5; ++k) {
      const std::size_t i = random() % r.size();
      switch (random() % 4) {
        case 0:
          r.position_rad[i] += 1e3;
          break;
        case 1:
          r.torque_nm[i] = 1e12;
          break;
        case 2:
          for (std::size_t n = i; n < r.size(); ++n) r.time_s[n] += 100;
          break;
        case 3:
          const std::size_t end = std::min(r.size(), i + 1 + random() % 200);
          for (auto* c : {&r.time_s, &r.position_rad, &r.velocity_rad_s, &r.torque_nm, &r.temperature_degC})
            c->erase(c->begin() + static_cast<std::ptrdiff_t>(i), c->begin() + static_cast<std::ptrdiff_t>(end));
          break;
      }
      if (r.size() < 3) break;
    }
    if (const auto found = levels_of(r))
      for (const Level& level : found->levels)
        ASSERT_TRUE(std::isfinite(level.friction_nm) && std::isfinite(level.stderr_nm) && level.stderr_nm >= 0)
            << trial;
  }
}

const std::string source = TRIBOTWIN_SOURCE_DIR;
namespace fs = std::filesystem;

double law_nm(const drive::Drive& drive, double speed_rad_s, double load_nm, double temperature_degC) {
  return mujoco::friction_nm(drive, speed_rad_s, load_nm / drive.torque_max_nm, temperature_degC);
}

TEST(TestCycle, MeasuresTheLawInUnderThreeMinutes) {
  const auto arm = with_payload(*mujoco::load_file(source + "/mjcf/br609.xml").value(), {.mass_kg = 2}).value();
  const auto bench = bench_of(*arm, true, 250);
  ASSERT_TRUE(bench) << bench.error().message;
  const drive::Drive& drive = arm->drives()[2].drive;
  Measurement me{.speeds_rad_s = test_cycle_speeds_rad_s(), .start_rad = std::vector<double>(6, 0.0)};
  me.heat = {.rise = thermal::steady_rise(drive.thermal, 20), .held = false};
  const Motion motion = test_cycle_of(**bench, 2, me.start_rad);
  EXPECT_LT(motion.duration_s(), 180);
  const auto recording = record(**bench, 2, motion, me);
  ASSERT_TRUE(recording) << recording.error().message;
  EXPECT_NEAR(recording->time_s[1], 1 / 250.0, 1e-9);
  const auto found = levels_of(*recording, {.speeds_rad_s = me.speeds_rad_s});
  ASSERT_TRUE(found) << found.error().message;
  ASSERT_EQ(found->levels.size(), 15);
  for (const Level& level : found->levels) {
    const double law = law_nm(drive, level.speed_rad_s, level.load_nm, level.temperature_degC);
    EXPECT_NEAR(level.friction_nm, law, 2e-3 * law) << level.speed_rad_s;
    EXPECT_NEAR(level.forward->friction_nm, level.backward->friction_nm, 0.02 * law);
  }
  EXPECT_NEAR(found->lag_s, 0, 0.001);

  // The cycle's own heat, from the law over the set speeds, is that of the simulation.
  const Gravity gravity(*arm, 2, me.start_rad);
  const thermal::Rise end =
      after_motion(drive, me.heat.rise, 0, motion, 2, [&](double q) { return gravity.load_nm(me.start_rad, q); });
  EXPECT_NEAR(drive.thermal.T_amb_degC + end.total_K(), recording->temperature_degC.back(), 0.01);
  EXPECT_GT(std::abs(recording->temperature_degC.back() - recording->temperature_degC.front()), 0.05);
}

TEST(TestCycle, FindsTheLagOfTheTorqueWithinASample) {
  const auto arm = mujoco::load_file(source + "/mjcf/br609.xml").value();
  const auto bench = bench_of(*arm, true, 250).value();
  for (const double lag : {0.0, 0.01, 0.04}) {  // the last is Zhou 2024's 4 deg at 100 deg/s
    Measurement me{
        .speeds_rad_s = test_cycle_speeds_rad_s(),
        .start_rad = std::vector<double>(6, 0.0),
        .sensors = {.encoder_increments_per_turn = 409600, .torque_noise_nm = 0.3, .sampling_hz = 250, .lag_s = lag}};
    const auto found = levels_of(*record(*bench, 2, test_cycle_of(*bench, 2, me.start_rad), me));
    ASSERT_TRUE(found) << found.error().message;
    EXPECT_NEAR(found->lag_s, lag, 0.004);
  }
}

TEST(Warmup, IsTheClosedFormWhereTheHeatIsConstant) {
  const auto drive = drive::make_drive("d", {{"law", "stribeck"},
                                             {"Fc", "0.1"},
                                             {"Fs", "0"},
                                             {"Fv", "0"},
                                             {"vs", "1"},
                                             {"alpha", "1"},
                                             {"torque_max_nm", "100"},
                                             {"gear_ratio", "10"},
                                             {"thermal", "first_order"},
                                             {"R_th", "0.5"},
                                             {"kappa", "1000"},
                                             {"T_amb", "20"}})
                         .value();
  const thermal::Rise hot = after_steady_work(drive, {}, 0, 2, 0, 1500);  // 10 Nm at 2 rad/s
  EXPECT_NEAR(hot.total_K(), 20 * 0.5 * (1 - std::exp(-1.5)), 1e-9);
  EXPECT_NEAR(after_steady_work(drive, hot, 0, 0, 0, 700).total_K(), hot.total_K() * std::exp(-0.7), 1e-9);
  EXPECT_NEAR(after_steady_work(drive, {}, 5, 0, 0, 1e6).total_K(), 5, 1e-9);  // a warmer room
}

TEST(Warmup, LongStepsAreEnoughWhereFrictionFallsWithTemperature) {
  const auto model = mujoco::load_file(source + "/mjcf/irb6620.xml").value();
  const drive::Drive& drive = model->drives()[1].drive;
  thermal::Rise rise, fine;
  rise = fine = thermal::steady_rise(drive.thermal, 15);
  rise = after_steady_work(drive, rise, 0, 1.2, 0.3, 7200);
  for (int k = 0; k < 7200; ++k) fine = after_steady_work(drive, fine, 0, 1.2, 0.3, 1);
  EXPECT_NEAR(rise.total_K(), fine.total_K(), 1e-3);
}

TEST(Gravity, FindsPosesAndTellsWhatThereIs) {
  const auto arm = with_payload(*mujoco::load_file(source + "/mjcf/irb6620.xml").value(), {.mass_kg = 75}).value();
  const auto& binding = arm->drives()[1];
  const Gravity gravity(*arm, 1, std::vector<double>(6, 0.0));
  const mujoco::DataPtr d = arm->make_data();
  for (const double load : {-0.73, -0.4, -0.02, 0.44}) {
    const auto pose = gravity.pose_for(load * 7500);
    ASSERT_TRUE(pose) << pose.error().message;
    for (std::size_t i = 0; i < 6; ++i) {
      const auto& other = arm->drives()[i];
      d->qpos[position_address(arm->get(), other)] = pose->position_rad[i];
      EXPECT_GE(pose->position_rad[i], (*arm)->jnt_range[2 * other.joint]);
      EXPECT_LE(pose->position_rad[i], (*arm)->jnt_range[2 * other.joint + 1]);
    }
    mj_forward(arm->get(), d.get());
    EXPECT_NEAR(d->qfrc_bias[binding.dof], load * 7500, 1e-3 * 7500);
    for (const double side : {-0.5, 0.5})
      EXPECT_NEAR(gravity.load_nm(pose->position_rad, pose->position_rad[1] + side * pose->width_rad), load * 7500,
                  0.0105 * 7500);
  }
  EXPECT_THAT(gravity.pose_for(0.9 * 7500).error().message, HasSubstr("gravity gives -0.78"));
}

class CampaignFiles : public testing::Test {
 protected:
  fs::path folder = [] {
    std::string name = (fs::temp_directory_path() / "tribotwin_lab_XXXXXX").string();
    return fs::path(::mkdtemp(name.data()));
  }();
  ~CampaignFiles() override { fs::remove_all(folder); }

  static std::string text(const std::string& series,
                          const std::string& head = "procedure: plus_minus\nspeeds_rad_s: [10, 100]\n") {
    return "model: " + source + "/mjcf/irb6620.xml\njoint: joint2\n" + head + "series:\n" + series;
  }
  static constexpr char simple[] =
      "  - {name: a, load: {by: torque, norm: [0, 0.3]}, temperature: {prescribed_degC: {from: 40, to: 60, count: "
      "3}}}\n";
  Campaign campaign(const std::string& yaml, const std::vector<std::string>& settings = {}) {
    std::ofstream(folder / "c.yaml") << yaml;
    return load_campaign(folder / "c.yaml", settings).value();
  }
  std::string refusal(const std::string& yaml, const std::vector<std::string>& settings = {}) {
    std::ofstream(folder / "c.yaml") << yaml;
    const auto read = load_campaign(folder / "c.yaml", settings);
    return read ? "accepted" : read.error().message;
  }
};

TEST_F(CampaignFiles, SeriesCombineLoadsAndTemperatures) {
  const Campaign grid = campaign(text(simple));
  ASSERT_EQ(grid.curves.size(), 6);
  EXPECT_EQ(grid.curves[1].conditions, "load 0 by torque, 50 degC");
  EXPECT_EQ(grid.curves[5].conditions, "load 0.3 by torque, 60 degC");
  EXPECT_EQ(grid.curves[5].number, 6);
  const Campaign pairs = campaign(text(
      "  - {name: a, load: {by: torque, norm: [0, 0.3]}, temperature: {prescribed_degC: [40, 50]}, combine: pairs}\n"));
  ASSERT_EQ(pairs.curves.size(), 2);
  EXPECT_EQ(pairs.curves[1].conditions, "load 0.3 by torque, 50 degC");
  const std::string random = text(
      "  - {name: a, load: {by: torque, norm: {from: -0.5, to: 0.5}}, temperature: {prescribed_degC: {from: 40, to: "
      "60}}, combine: random, count: 40}\n");
  const Campaign drawn = campaign(random), again = campaign(random), other = campaign(random, {"seed=2"});
  ASSERT_EQ(drawn.curves.size(), 40);
  EXPECT_EQ(drawn.curves[7].conditions, again.curves[7].conditions);
  EXPECT_NE(drawn.curves[7].conditions, other.curves[7].conditions);
  for (const Curve& c : drawn.curves) EXPECT_LE(std::abs(c.measurement.external_nm), 3750);
  const Campaign speeds = campaign(
      text(simple, "procedure: plus_minus\nspeeds_rad_s: {from: 1, to: 100, count: 3, spacing: logarithmic}\n"));
  EXPECT_NEAR(speeds.curves[0].measurement.speeds_rad_s[1], 10 / 178.0, 1e-12);
}

TEST_F(CampaignFiles, WarmUpsFollowTheThermalModel) {
  const Campaign c = campaign(
      text("  - name: a\n    load: {by: torque, norm: [0, 0.5]}\n    temperature:\n      heating:\n        "
           "ambient_degC: 22\n        start_degC: 30\n"
           "        steps: [{duration_s: 0}, {speed_rad_s: 200, duration_s: 7200}, {duration_s: 3600, repeat: 2}]\n"));
  ASSERT_EQ(c.curves.size(), 8);
  const auto temperature = [&](std::size_t i) { return 25 + c.curves[i].measurement.heat.rise.total_K(); };
  EXPECT_DOUBLE_EQ(temperature(0), 30);
  EXPECT_GT(temperature(1), 40);
  EXPECT_LT(temperature(2), temperature(1));
  EXPECT_LT(temperature(3), temperature(2));
  EXPECT_NEAR((temperature(2) - 22) / (temperature(1) - 22), std::exp(-3600 / 10944.0),
              0.02);                          // the observation heats a little
  EXPECT_GT(temperature(5), temperature(1));  // more load, more heat
  for (const Curve& curve : c.curves) EXPECT_FALSE(curve.measurement.heat.held);
}

TEST_F(CampaignFiles, KeysOfTheDriveAreReplaced) {
  const Campaign c = campaign(text(
      simple, "procedure: plus_minus\nspeeds_rad_s: [10]\ndrive: {temperature_min_degC: 30, validity: extrapolate}\n"));
  const auto& law = c.model->drives()[1].drive.law;
  EXPECT_EQ(law.range.temperature_min_degC, 30);
  EXPECT_EQ(law.validity, friction::Validity::extrapolate);
  EXPECT_EQ(c.model->drives()[0].drive.law.range.temperature_min_degC, 38);
  // Another law comes with its own parameters; what is measured is that law.
  const Campaign other = campaign(text(simple,
                                       "procedure: plus_minus\nspeeds_rad_s: [10]\ndrive: {law: stribeck, Fc: 0.03, "
                                       "Fs: 0.05, Fv: 3.0e-4, vs: 10, alpha: 1.3}\n"));
  const auto rows = measured_rows(other, other.curves[0]);
  ASSERT_TRUE(rows) << rows.error().message;
  std::istringstream cells(*rows);
  std::string cell;
  for (int i = 0; i < 6; ++i) std::getline(cells, cell, ',');
  const double law_norm = 0.03 + 0.05 * std::exp(-1.0) + 3e-3;
  EXPECT_NEAR(std::stod(cell), law_norm, 1e-3 * law_norm);
}

TEST_F(CampaignFiles, WrongOnesAreRefusedWithFileAndKey) {
  const std::string head = "procedure: plus_minus\nspeeds_rad_s: [10, 100]\n";
  const auto series = [&](const std::string& keys) { return text("  - {name: a, " + keys + "}\n"); };
  const std::string load = "load: {by: torque, norm: 0}", temperature = "temperature: {prescribed_degC: 50}";
  const std::pair<std::string, std::string> cases[] = {
      {text(simple, head + "sed: 3\n"), "sed: is not known; did you mean 'seed'?"},
      {text(simple, "procedure: plus\nspeeds_rad_s: [1]\n"),
       "procedure: 'plus' is not known; did you mean 'plus_minus'"},
      {text(simple, "procedure: plus_minus\n"), "speeds_rad_s: is missing"},
      {text(simple, "procedure: plus_minus\nspeeds_rad_s: [10, 10.2]\n"), "too close to be separated"},
      {text(simple, "procedure: plus_minus\nspeeds_rad_s: [-3]\n"), "speeds_rad_s: is -3 but must be within"},
      {text(simple, "procedure: plus_minus\nspeeds_rad_s: {from: 1, to: 5}\n"), "speeds_rad_s.count: is missing"},
      {text(simple, "procedure: plus_minus\nspeeds_rad_s: {from: 0, to: 5, count: 3, spacing: logarithmic}\n"),
       "speeds_rad_s.from: is 0 but must be"},
      {text(simple, "procedure: plus_minus\nspeeds_rad_s: [0.001]\n"), "stick and slip"},
      {text(simple, "procedure: test_cycle\nspeeds_rad_s: [1]\n"), "speeds_rad_s: is for plus_minus"},
      {text(simple, "procedure: test_cycle\nstart_rad: {joint2: 1.5}\n"), "joint: the test cycle takes it to"},
      {text(simple, head + "drive: {Fc1: 3}\n"), "drive: key 'Fc1' is not known"},
      {text(simple, head + "drive: {law: none}\n"), "drive: law 'none' is not known"},
      {text(simple, head + "sensors: {sampling_hz: 5}\n"), "sensors.sampling_hz: is 5 but must be within 20 .. 10000"},
      {text(simple, head + "servo: {integral_time_s: 0}\n"), "servo.integral_time_s: is 0 but must be within"},
      {text(simple, head + "start_rad: {joint7: 1}\n"), "did you mean 'joint1'"},
      {text("  []\n"), "series: is missing"},
      {series("load: {by: pose, norm: 0.9}, " + temperature),
       "no pose of this joint and the next one outward gives the load 0.9"},
      {series("load: {by: wind, norm: 0}, " + temperature), "load.by: 'wind' is not known"},
      {series("load: {by: payload, norm: 0}, " + temperature), "mass_kg: is missing"},
      {series("load: {by: torque, norm: x}, " + temperature), "load.norm: is 'x' but must be a finite number"},
      {series(load + ", temperature: {prescribed_degC: 50, heating: {}}"), "temperature: needs either"},
      {series(load + ", temperature: {heating: {steps: []}}"), "steps: must be a list"},
      {series(load + ", temperature: {heating: {steps: [{duration_s: 1, speed: 3}]}}"), "steps[0].speed: is not known"},
      {series(load + ", " + temperature + ", combine: random"), "count: is missing"},
      {series(load + ", " + temperature + ", count: 3"), "count: is for combine: random"},
      {series("load: {by: torque, norm: [0, 1]}, " + temperature + ", combine: pairs"),
       "pairs needs as many loads as temperatures, but there are 2 and 1"},
      {series(load + ", " + temperature + "}\n  - {name: a, " + load + ", " + temperature),
       "name: 'a' is the name of another series"},
      {text("  - {name: 'a,b', " + load + ", " + temperature + "}\n"), "no comma"},
      {text(simple, head + "drive: {thermal: prescribed}\n") + "  - {name: b, " + load +
           ", temperature: {heating: {steps: [{duration_s: 1}]}}}\n",
       "needs a thermal model"},
      {text(simple, head + "drive: {validity: error, temperature_min_degC: 45}\n"),
       "leaves the range of law 'extended'"},
      {text("  - {name: a, load: {by: pose, norm: 0}, " + temperature + "}\n",
            "procedure: test_cycle\nstart_rad: {joint2: 0.5}\n"),
       "pose is not possible with the test cycle"},
  };
  for (const auto& [yaml, says] : cases) {
    const std::string refused = refusal(yaml);
    EXPECT_THAT(refused, HasSubstr(says)) << yaml;
    EXPECT_THAT(refused, HasSubstr("c.yaml:")) << yaml;
  }
  EXPECT_THAT(refusal(text(simple), {"seed"}), HasSubstr("must be key=value"));
  EXPECT_THAT(refusal(text(simple), {"series.1.name=b"}), HasSubstr("must be a number from 0 to 0"));
  EXPECT_THAT(refusal(text(simple), {"seed.x=1"}),
              testing::AnyOf(HasSubstr("no mapping"), HasSubstr("must be a number")));
  EXPECT_EQ(campaign(text(simple), {"series.0.load.norm=0.1", "drive.temperature_min_degC=20"}).curves.size(), 3);
}

TEST_F(CampaignFiles, TheWholeChainIsExactWithoutNoiseAndCalibratedWithIt) {
  const std::string series =
      "  - {name: torque, load: {by: torque, norm: {from: -0.7, to: 0.7}}, temperature: {prescribed_degC: {from: 40, "
      "to: 80}}, combine: random, count: 8}\n"
      "  - {name: pose, load: {by: pose, norm: {from: -0.7, to: 0.4}, payload_kg: 75}, temperature: {prescribed_degC: "
      "{from: 40, to: 80}}, combine: random, count: 8}\n"
      "  - {name: payload, load: {by: payload, mass_kg: [0, 100]}, temperature: {prescribed_degC: [40, 55, 70, 80]}}\n";
  const std::string head =
      "procedure: plus_minus\nspeeds_rad_s: [2, 6, 15, 35, 60, 100, 150, 200, 275]\nstart_rad: {joint2: 0.3, joint3: "
      "0.4}\n";
  for (const std::string sensors :
       {"", "sensors: {encoder_increments_per_turn: 729088, torque_noise_nm: 20, sampling_hz: 250, lag_s: 0.006}\n"}) {
    const Campaign c = campaign(text(series, head + sensors));
    const auto done = run_campaign(c, {.directory = folder / (sensors.empty() ? "exact" : "noisy")});
    ASSERT_TRUE(done) << done.error().message;
    EXPECT_EQ(done->levels, 24 * 9);
    const Table table = read_table(folder / (sensors.empty() ? "exact" : "noisy") / "curves.csv").value();
    const auto column = [&](const char* name) { return table.numbers(name).value(); };
    const auto speed = column("speed_rad_s"), load = column("load_norm"), T = column("temperature_degC"),
               friction = column("friction_nm"), error = column("stderr_nm"), lag = column("lag_s"),
               forward = column("friction_forward_norm"), backward = column("friction_backward_norm");
    const drive::Drive& drive = c.model->drives()[1].drive;
    double square = 0;
    for (std::size_t i = 0; i < speed.size(); ++i) {
      const double law = mujoco::friction_nm(drive, speed[i] / 178, load[i], T[i]);
      if (sensors.empty())
        EXPECT_NEAR(friction[i], law, 2e-3 * law) << c.curves[i / 9].conditions << ", " << speed[i];
      else
        EXPECT_NEAR(friction[i], law, 5 * error[i]) << c.curves[i / 9].conditions << ", " << speed[i];
      if (!sensors.empty()) EXPECT_NEAR(lag[i], 0.006, 0.004);
      EXPECT_NEAR(0.5 * (forward[i] + backward[i]), friction[i] / 7500, 1e-3);
      square += std::pow((friction[i] - law) / error[i], 2);
    }
    if (sensors.empty()) continue;
    const double spread = std::sqrt(square / static_cast<double>(speed.size()));
    fmt::print("spread of scores {:.3f}\n", spread);
    EXPECT_GT(spread, 0.8);
    EXPECT_LT(spread, 1.2);
  }
}

TEST_F(CampaignFiles, LevelNoiseIsInTheStandardError) {
  const Campaign c = campaign(text(
      "  - {name: a, load: {by: torque, norm: 0}, temperature: {prescribed_degC: {from: 50, to: 50, count: 100}}}\n",
      "procedure: plus_minus\nspeeds_rad_s: [100, 200]\nlevel_noise_nm: 15\n"));
  ASSERT_TRUE(run_campaign(c, {.directory = folder / "out"}));
  const Table table = read_table(folder / "out" / "curves.csv").value();
  const auto speed = table.numbers("speed_rad_s").value(), friction = table.numbers("friction_nm").value(),
             error = table.numbers("stderr_nm").value();
  double square = 0;
  for (std::size_t i = 0; i < speed.size(); ++i) {
    EXPECT_NEAR(error[i], 15, 0.1);
    square += std::pow((friction[i] - law_nm(c.model->drives()[1].drive, speed[i] / 178, 0, 50)) / error[i], 2);
  }
  EXPECT_NEAR(std::sqrt(square / static_cast<double>(speed.size())), 1, 0.2);
}

TEST_F(CampaignFiles, ParallelRunsGiveTheSameBytes) {
  const Campaign c = campaign(text(
      simple, "procedure: plus_minus\nspeeds_rad_s: [50, 200]\nlevel_noise_nm: 3\nsensors: {torque_noise_nm: 20}\n"));
  const auto bytes = [&](const char* name, unsigned threads) {
    const auto done = run_campaign(c, {.directory = folder / name, .threads = threads});
    EXPECT_TRUE(done) << done.error().message;
    std::ifstream stream(folder / name / "curves.csv");
    return std::string(std::istreambuf_iterator<char>(stream), {});
  };
  const std::string one = bytes("one", 1);
  EXPECT_EQ(one, bytes("four", 4));
  // A curve is its own: a campaign of fewer measures it the same but for its number.
  EXPECT_EQ(std::ranges::count(one, '\n'), 13);
  EXPECT_EQ(*measured_rows(c, c.curves[2]), *measured_rows(c, c.curves[2]));
  EXPECT_NE(measured_rows(c, c.curves[0])->substr(4), measured_rows(c, c.curves[3])->substr(4));
}

TEST_F(CampaignFiles, FailuresNameTheCurve) {
  Campaign c = campaign(text(simple));
  c.curves[3].measurement.speeds_rad_s = {1e-6};  // cannot come from a file: it is checked there
  c.curves[3].measurement.start_rad[1] = 0;
  const auto done = run_campaign(c, {.directory = folder / "out", .threads = 2});
  ASSERT_FALSE(done);
  EXPECT_THAT(done.error().message, HasSubstr("curve 4 of series 'a' (load 0.3 by torque, 40 degC): no steady motion"));
  EXPECT_FALSE(fs::exists(folder / "out" / "curves.csv"));
}

TEST(ShippedCampaigns, AreWhatTheyClaim) {
  const struct {
    const char* name;
    std::size_t curves, levels;
  } shipped[] = {{"irb6620_load", 50, 600},
                 {"irb6620_temperature", 100, 1200},
                 {"irb6620_validation", 60, 720},
                 {"irb6620_all", 488, 5856},
                 {"br609", 15, 225}};
  for (const auto& s : shipped) {
    const Campaign c = load_campaign(source + "/twin/scenarios/" + s.name + "_campaign.yaml").value();
    std::size_t levels = 0;
    for (const Curve& curve : c.curves) levels += curve.measurement.speeds_rad_s.size();
    EXPECT_EQ(c.curves.size(), s.curves) << s.name;
    EXPECT_EQ(levels, s.levels) << s.name;
  }
}

}  // namespace
}  // namespace tribotwin::twin
