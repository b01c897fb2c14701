// What a shadow says of sessions whose robot is known.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/hil/shadow/shadow.hpp>
#include <tribotwin/tests/hil/shadow/recorded_session.hpp>

namespace tribotwin::hil {
namespace {

twin::Scenario robot(const std::vector<std::string>& settings = {}) {
  return twin::load_scenario(std::string(TRIBOTWIN_SOURCE_DIR) + "/twin/scenarios/irb6620_hold.yaml", settings).value();
}

Result<ShadowResult> listen(const std::vector<Frame>& frames, const ShadowOptions& options) {
  std::size_t i = 0;
  return shadow(
      robot(),
      [&](Frame& frame) -> Result<bool> {
        if (i == frames.size()) return false;
        frame = frames[i++];
        return true;
      },
      options);
}

bool is_tpdo(const Frame& f) { return f.id > 0x180 && f.id < 0x580; }

std::vector<Frame> lost(std::vector<Frame> frames, double share) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> u(0, 1);
  std::erase_if(frames, [&](const Frame& f) { return is_tpdo(f) && u(random) < share; });
  return frames;
}

/// A logger whose stamps are late by up to `late_s`; frames stay in order.
std::vector<Frame> stamped_late(std::vector<Frame> frames, double late_s) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> u(0, late_s);
  std::int64_t last = 0;
  for (auto& f : frames) last = f.time_ns = std::max<std::int64_t>(last, f.time_ns + std::llround(1e9 * u(random)));
  return frames;
}

struct Heard {
  const char* name;
  SessionPlan plan;
  double lost = 0, late_s = 0;
  double rms_nm = 15, limit_nm = 100;
  double judged = 0.9;  // share of the cycles
};

void PrintTo(const Heard& t, std::ostream* out) { *out << t.name; }

class HealthyRobots : public testing::TestWithParam<Heard> {};

// The drives send the mean torque since the SYNC before. Sampled at the SYNC, at one phase of the ripple that the set
// points make, the errors would be 20 Nm RMS at 2 ms, in proportion to cycle and acceleration.
TEST_P(HealthyRobots, HaveSmallResiduals) {
  const Heard& h = GetParam();
  const auto scenario = robot();
  const auto frames = stamped_late(lost(RecordedSession(scenario, h.plan).frames, h.lost), h.late_s);
  const auto result = listen(frames, {.profile = h.plan.profile, .limit_nm = h.limit_nm, .limit_time_s = 0.1});
  ASSERT_TRUE(result) << result.error().message;
  for (const auto& j : result->joints) {
    EXPECT_GT(static_cast<double>(j.samples), h.judged * 1e6 * h.plan.seconds / h.plan.cycle_us) << j.name;
    EXPECT_LT(j.residual_rms_nm, h.rms_nm) << j.name;
    EXPECT_NEAR(static_cast<double>(j.positions_lost) * h.plan.cycle_us / 1e6 / h.plan.seconds, h.lost, 0.05) << j.name;
    EXPECT_NEAR(static_cast<double>(j.torques_lost) * h.plan.cycle_us / 1e6 / h.plan.seconds, h.lost, 0.05) << j.name;
  }
  EXPECT_NEAR(result->cycle_s, 1e-6 * h.plan.cycle_us, 0.05e-6 * h.plan.cycle_us);
  EXPECT_FALSE(result->exceeded());
  EXPECT_THAT(result->unchecked, testing::IsEmpty());
}

constexpr Profile mirror = Profile::mirror;
INSTANTIATE_TEST_SUITE_P(
    All, HealthyRobots,
    testing::Values(Heard{.name = "lockstep"}, Heard{.name = "realtime", .plan = {.lockstep = false}},
                    Heard{.name = "jittery_master",
                          .plan = {.lockstep = false, .amplitude_rad = 0.05, .sync_jitter_s = 3e-4},
                          .rms_nm = 25},
                    Heard{.name = "lost_5", .lost = 0.05}, Heard{.name = "lost_20", .lost = 0.2, .limit_nm = 150},
                    Heard{.name = "late_stamps", .late_s = 1e-3},
                    Heard{.name = "cycle_10_ms", .plan = {.cycle_us = 10000, .amplitude_rad = 0.02}, .rms_nm = 5},
                    Heard{.name = "cycle_10_ms_lost_20",
                          .plan = {.cycle_us = 10000, .amplitude_rad = 0.02},
                          .lost = 0.2,
                          .rms_nm = 5},
                    Heard{.name = "mirror", .plan = {.profile = mirror}},
                    Heard{.name = "mirror_lost_20", .plan = {.profile = mirror}, .lost = 0.2, .limit_nm = 150},
                    Heard{.name = "mirror_realtime", .plan = {.profile = mirror, .lockstep = false}}),
    [](const auto& info) { return info.param.name; });

struct Trouble {
  const char* name;
  SessionPlan plan;
  std::vector<std::string> robot;
  double lost = 0;
};

void PrintTo(const Trouble& t, std::ostream* out) { *out << t.name; }

class FaultyRobots : public testing::TestWithParam<Trouble> {};

TEST_P(FaultyRobots, RaiseAnAlarm) {
  const Trouble& t = GetParam();
  const auto scenario = robot(t.robot);
  const auto result = listen(lost(RecordedSession(scenario, t.plan).frames, t.lost),
                             {.profile = t.plan.profile, .limit_nm = 150, .limit_time_s = 0.3});
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_TRUE(result->joints[1].exceeded);
}

INSTANTIATE_TEST_SUITE_P(
    All, FaultyRobots,
    testing::Values(Trouble{.name = "load", .plan = {.load_nm = -300}},
                    Trouble{.name = "load_lost_20", .plan = {.load_nm = -300}, .lost = 0.2},
                    Trouble{.name = "load_realtime", .plan = {.profile = mirror, .lockstep = false, .load_nm = 300}},
                    Trouble{.name = "load_jittery_master",
                            .plan = {.lockstep = false, .amplitude_rad = 0.05, .sync_jitter_s = 3e-4, .load_nm = 300}},
                    Trouble{.name = "load_10_ms", .plan = {.cycle_us = 10000, .amplitude_rad = 0.02, .load_nm = 300}},
                    Trouble{.name = "friction",
                            .robot = {"events=[{time_s: 3, type: wear, joint: joint2, factors: {Fc0: 3}}]"}}),
    [](const auto& info) { return info.param.name; });

// A brake carries what the drive does not: no torque, and no residual.
TEST(Shadow, JudgesOnlyEnabledDrives) {
  const auto scenario = robot();
  for (const Profile profile : {Profile::cia402, Profile::mirror}) {
    const auto frames = RecordedSession(scenario, {.profile = profile, .seconds = 2, .enabled = false}).frames;
    const auto result = listen(frames, {.profile = profile, .limit_nm = 1});
    ASSERT_TRUE(result) << result.error().message;
    EXPECT_FALSE(result->exceeded());
    EXPECT_EQ(result->joints[1].samples, 0U);
    EXPECT_GT(result->joints[1].not_enabled, 800U);
    EXPECT_THAT(result->unchecked, testing::ElementsAre(testing::AllOf(testing::HasSubstr("enabled drive"),
                                                                       testing::HasSubstr("joint1, joint2"),
                                                                       testing::HasSubstr("brakes"))));
  }
}

TEST(Shadow, NamesTheTorqueThatIsMissing) {
  const auto scenario = robot();
  auto frames = RecordedSession(scenario, {.seconds = 2}).frames;
  std::erase_if(frames, [](const Frame& f) { return f.id == 0x483; });
  const auto result = listen(frames, {.limit_nm = 1000});
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_THAT(result->unchecked,
              testing::ElementsAre(testing::AllOf(testing::HasSubstr("no torque was heard of joint3:"),
                                                  testing::HasSubstr("6077h"), testing::HasSubstr("1A03h"))));
  EXPECT_GT(result->joints[1].samples, 700U);
}

TEST(Shadow, NamesTheStateThatIsMissing) {
  const auto scenario = robot();
  auto frames = RecordedSession(scenario, {.seconds = 2}).frames;
  // The statusword gives its place in TPDO3 to another object, and no other TPDO has it.
  std::erase_if(frames, [](const Frame& f) { return f.id == 0x183 || f.id == 0x283; });
  frames.insert(frames.begin(), classic(0x603, download(0x1A02, 1, Type::u32, 0x603F0010)));
  const auto result = listen(frames, {.limit_nm = 1000});
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_THAT(result->unchecked,
              testing::ElementsAre(
                  testing::AllOf(testing::HasSubstr("no state was heard of joint3:"), testing::HasSubstr("6041h"))));
}

TEST(Shadow, RefusesACycleThatIsNotThatOfTheBus) {
  const auto scenario = robot();
  const auto frames = RecordedSession(scenario, {.cycle_us = 10000, .seconds = 2}).frames;
  const auto result = listen(frames, {.cycle_us = 2000, .cycle_expected = true});
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().kind, ErrorKind::input);
  EXPECT_THAT(result.error().message,
              testing::AllOf(testing::HasSubstr("--cycle 2 "), testing::HasSubstr("every 10 ms"),
                             testing::HasSubstr("--lockstep")));
  EXPECT_TRUE(listen(frames, {.cycle_us = 10000, .cycle_expected = true}));
}

// A master that does not wait for the clock: the stamps say nothing of the robot's time.
TEST(Shadow, TakesTheSyncForTheClockInLockstep) {
  const auto scenario = robot();
  auto frames = RecordedSession(scenario, {}).frames;
  std::mt19937_64 random(9);
  std::exponential_distribution<double> busy(1 / 7e5);
  std::int64_t time = 0;
  for (Frame& f : frames) f.time_ns = time += f.id == 0x80 ? 200'000 + std::llround(busy(random)) : 0;
  const auto as_stamped = listen(frames, {.limit_nm = 100});
  ASSERT_TRUE(as_stamped);
  EXPECT_THAT(as_stamped->table(), testing::HasSubstr("--lockstep"));
  EXPECT_GT(as_stamped->joints[1].residual_rms_nm, 100);
  const auto result = listen(frames, {.lockstep = true, .limit_nm = 100});
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_FALSE(result->exceeded());
  EXPECT_LT(result->joints[1].residual_rms_nm, 30);
}

// A torque that ends and comes back is not compared in between, nor across the gap.
TEST(Shadow, JudgesNothingAcrossAGap) {
  const auto scenario = robot();
  auto frames = RecordedSession(scenario, {}).frames;
  std::erase_if(frames, [](const Frame& f) { return f.id == 0x383 && f.time_ns > 3000 * ms && f.time_ns < 4000 * ms; });
  const auto result = listen(frames, {.limit_nm = 100});
  ASSERT_TRUE(result) << result.error().message;
  const auto& j = result->joints[2];
  EXPECT_NEAR(static_cast<double>(j.positions_lost), 500, 2);
  EXPECT_EQ(j.torques_lost, 0U);
  EXPECT_NEAR(static_cast<double>(j.position_missing), 525, 30);
  for (const auto& joint : result->joints) EXPECT_LT(joint.residual_max_nm, 150) << joint.name;
}

}  // namespace
}  // namespace tribotwin::hil
