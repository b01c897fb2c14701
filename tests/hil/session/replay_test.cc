// What a replay says of a session's events that it cannot repeat.
#include <filesystem>
#include <fstream>
#include <new>
#include <string>

#include <gmock/gmock.h>

#include <tribotwin/hil/session/replay.hpp>
#include <tribotwin/hil/session/session_file.hpp>

namespace tribotwin::hil {
namespace {

using testing::HasSubstr;

class ReplayOfAnEvent : public testing::Test {
 protected:
  std::filesystem::path folder =
      std::filesystem::path(testing::TempDir()) / testing::UnitTest::GetInstance()->current_test_info()->name();
  std::filesystem::path log = folder / "session.log";
  twin::Scenario scenario =
      twin::load_scenario(std::string(TRIBOTWIN_SOURCE_DIR) + "/twin/scenarios/irb6620_hold.yaml").value();
  void SetUp() override {
    std::filesystem::remove_all(folder);
    std::filesystem::create_directories(folder);
  }
  void TearDown() override { std::filesystem::remove_all(folder); }

  /// A session whose first turn has an event and a SYNC.
  Result<ReplayResult> replay_of(const std::string& event, const SessionEvents& events = {}) {
    constexpr std::int64_t start_ns = 1'000'000'000'000;
    std::ofstream(log) << "(1000.000000) can0 080#\n";
    auto writer = SessionWriter::create(session_file_of(log), {.start_ns = start_ns});
    if (!writer || !writer->write({.time_ns = start_ns, .events = {event}}) || !writer->finish())
      return tl::unexpected<Error>("no session was written");
    return replay(scenario, log, {.events = events});
  }
};

TEST_F(ReplayOfAnEvent, SaysThatItHappened) {
  int happened = 0;
  const auto result = replay_of("{type: marker, text: here}", {.happened = [&](double, const auto&) { ++happened; }});
  EXPECT_TRUE(result) << result.error().message;
  EXPECT_EQ(happened, 1);
}

TEST_F(ReplayOfAnEvent, RefusesWhatTheScenarioCannotHave) {
  const auto result = replay_of("{type: wear, joint: none, factors: {}}");
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().kind, ErrorKind::input);
  EXPECT_THAT(result.error().message, HasSubstr("has an event that this scenario cannot have"));
}

// It is no fault of the session's file.
TEST_F(ReplayOfAnEvent, LetsWantOfMemoryPass) {
  EXPECT_THROW(
      (void)replay_of("{type: marker, text: here}", {.happened = [](double, const auto&) { throw std::bad_alloc(); }}),
      std::bad_alloc);
}

}  // namespace
}  // namespace tribotwin::hil
