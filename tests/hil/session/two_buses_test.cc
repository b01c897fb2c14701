// One robot on two buses: three drives on each, with the node numbers 1 to 3.
#include <algorithm>
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/hil/mirror/mirror_frames.hpp>
#include <tribotwin/hil/session/bench.hpp>
#include <tribotwin/tests/hil/one_drive.hpp>

namespace tribotwin::hil {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::Not;

constexpr int cycle_ms = 2;
constexpr std::size_t a = 0, b = 1;  // the buses

class TwoBuses : public testing::Test {
 protected:
  twin::Scenario scenario =
      twin::load_scenario(std::string(TRIBOTWIN_SOURCE_DIR) + "/twin/scenarios/irb6620_hold.yaml").value();
  std::vector<Frame> said[2];
  bool link[2] = {true, true};
  std::int64_t now = 0;
  Bench bench{scenario, {.wiring = {{0, 1, 2}, {3, 4, 5}}, .cycle_us = 1000 * cycle_ms}, send()};

  Bench::SendOn send() {
    return [this](std::size_t bus, const Frame& frame) {
      if (!link[bus]) return Sent::down;
      said[bus].push_back(frame);
      return Sent::done;
    };
  }
  void give(std::size_t bus, std::uint32_t id, std::vector<std::uint8_t> bytes = {}) {
    if (link[bus]) ASSERT_TRUE(bench.receive(bus, classic(id, bytes), now));
  }
  void pass(int milliseconds) {
    for (int i = 0; i < milliseconds; ++i) {
      now += ms;
      ASSERT_TRUE(bench.tick(now));
    }
  }
  void sync(std::size_t bus) { give(bus, 0x80); }
  double time_s() { return bench.plant().twin().time_s(); }
  Node& node(std::size_t drive) { return dynamic_cast<Node&>(*bench.drives()[drive]); }
  std::vector<std::uint32_t> identifiers(std::size_t bus) {
    std::vector<std::uint32_t> ids;
    for (const Frame& frame : said[bus]) ids.push_back(frame.id);
    return ids;
  }
  /// How many TPDO3 of its first drive are on the bus.
  auto answers(std::size_t bus) { return std::ranges::count(said[bus], 0x381U, &Frame::id); }

  void enable(std::size_t bus) {
    give(bus, 0, {1, 0});
    for (std::uint32_t n = 1; n <= 3; ++n)
      for (const std::uint8_t word : {0x06, 0x07, 0x0F}) give(bus, 0x200 + n, {word, 0});
  }
  /// CSP: all drives of the bus turn on by so many counts.
  void command(std::size_t bus, std::int32_t counts) {
    for (std::uint32_t n = 1; n <= 3; ++n) {
      std::vector<std::uint8_t> data{0x0F, 0, 0, 0, 0, 0};
      encode(start[3 * bus + n - 1] + counts, std::span(data).subspan(2));
      give(bus, 0x400 + n, data);
    }
  }
  /// A master with one program for both buses. `syncs`: which of them it reaches.
  void run(int cycles, const std::vector<std::size_t>& buses) {
    for (int i = 0; i < cycles; ++i, ++k) {
      for (const std::size_t bus : buses) command(bus, 50 * k);
      pass(cycle_ms);
      for (const std::size_t bus : buses) sync(bus);
    }
  }
  void begin() {
    bench.start(now);
    for (std::size_t i = 0; i < 6; ++i) start[i] = node(i).dictionary().get(0x6064);
    for (const std::size_t bus : {a, b}) enable(bus);
    for (std::size_t i = 0; i < 6; ++i) ASSERT_EQ(node(i).state(), DriveState::operation_enabled);
  }
  std::int64_t start[6] = {};
  int k = 0;
};

TEST_F(TwoBuses, EachHasItsOwnNodes) {
  bench.start(now);
  EXPECT_THAT(identifiers(a), ElementsAre(0x701, 0x702, 0x703));
  EXPECT_THAT(identifiers(b), ElementsAre(0x701, 0x702, 0x703));
  said[a].clear(), said[b].clear();
  give(b, 0x602, {0x40, 0x18, 0x10, 4, 0, 0, 0, 0});  // 1018h:04 of joint5
  EXPECT_THAT(said[a], IsEmpty());
  ASSERT_THAT(identifiers(b), ElementsAre(0x582));
  EXPECT_EQ(said[b][0].data[4], 5);  // no two drives of a robot have one serial number
  give(b, 0, {1, 0});
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(node(i).nmt(), i < 3 ? Nmt::pre_operational : Nmt::operational) << i;
  EXPECT_EQ(bench.sender(a, classic(0x703, {})), 2U);
  EXPECT_EQ(bench.sender(b, classic(0x703, {})), 5U);
  EXPECT_EQ(bench.counters(a).frames_in, 0U);
  EXPECT_EQ(bench.counters(b).frames_in, 2U);
}

TEST_F(TwoBuses, TheNamedOrderIsThatOfTheNodes) {
  const auto p = drive_parameters(scenario, 11, 2000, {{4, 0, 2}, {3, 1, 5}});
  std::vector<int> nodes;
  for (const DriveParameters& one : p) nodes.push_back(one.node);
  EXPECT_THAT(nodes, ElementsAre(12, 12, 13, 11, 11, 13));
}

TEST_F(TwoBuses, TheRobotMovesOnceBothSyncsCame) {
  bench.start(now);
  for (int i = 0; i < 10; ++i) {
    const auto [first, second] = i % 2 ? std::pair(a, b) : std::pair(b, a);
    pass(cycle_ms);
    sync(first);
    EXPECT_NEAR(time_s(), 2e-3 * i, 1e-9);
    sync(second);
    EXPECT_NEAR(time_s(), 2e-3 * (i + 1), 1e-9);
  }
  EXPECT_EQ(bench.counters(a).syncs, 10U);
  EXPECT_EQ(bench.counters(b).syncs, 10U);
  EXPECT_EQ(bench.counters(a).sync_alone + bench.counters(b).sync_alone, 0U);
}

// Two masters, each of which waits for its answers: the slower one is the clock of both.
TEST_F(TwoBuses, ABusThatIsAheadWaits) {
  bench.start(now);
  for (const std::size_t bus : {a, b}) give(bus, 0, {1, 0});
  sync(b);
  EXPECT_EQ(answers(b), 1);
  sync(b);
  give(b, 0x601, {0x40, 0x41, 0x60, 0, 0, 0, 0, 0});  // comes behind a SYNC that waits
  EXPECT_EQ(answers(b), 1);
  EXPECT_THAT(identifiers(b), Not(Contains(0x581)));
  EXPECT_EQ(time_s(), 0);
  for (int i = 1; i <= 10; ++i) {
    pass(30);
    EXPECT_EQ(answers(b), i);
    sync(a);
    EXPECT_EQ(answers(a), i);
    EXPECT_EQ(answers(b), i + 1);
    EXPECT_NEAR(time_s(), 2e-3 * i, 1e-9);
    sync(b);
  }
  EXPECT_THAT(identifiers(b), Contains(0x581));
  EXPECT_EQ(bench.counters(a).sync_alone + bench.counters(b).sync_alone, 0U);
}

// A master that waits for nothing is not held up either.
TEST_F(TwoBuses, AThirdSyncEndsTheCycle) {
  bench.start(now);
  give(a, 0, {1, 0});
  for (int i = 1; i <= 10; ++i) {
    sync(a);
    EXPECT_EQ(answers(a), std::max(1, i - 1));
    EXPECT_NEAR(time_s(), 2e-3 * std::max(0, i - 2), 1e-9);
  }
  EXPECT_EQ(bench.counters(b).sync_alone, 8U);
  EXPECT_EQ(bench.counters(a).sync_alone, 0U);
}

// A master that waits for its answers has them before its drives miss anything, and after that at once.
TEST_F(TwoBuses, ASilentBusIsGivenUp) {
  begin();
  run(5, {a, b});
  const auto before = answers(a);
  const double before_s = time_s();
  for (int i = 0; i < 2; ++i) pass(cycle_ms), command(a, 50 * k++), sync(a);
  EXPECT_EQ(answers(a), before + 1);
  EXPECT_LE(bench.next_ns(), now + (50 - 2 * cycle_ms) * ms + 1);  // then it looks again
  pass(50 - 2 * cycle_ms);
  EXPECT_EQ(answers(a), before + 1);
  pass(1);
  EXPECT_EQ(answers(a), before + 2);
  for (int i = 0; i < 100; ++i) {
    EXPECT_NEAR(time_s(), before_s + 2e-3 * (i + 2), 1e-9);
    run(1, {a});
    EXPECT_EQ(answers(a), before + i + 3);
  }
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(node(i).state(), DriveState::operation_enabled) << i;
}

// Its drives end in fault; the other bus has every cycle and every answer, and its arm no jump.
TEST_F(TwoBuses, ASilentBusStopsNoOther) {
  begin();
  run(50, {a, b});
  for (const std::size_t silent : {b, a}) {
    SCOPED_TRACE(silent);
    const std::size_t living = 1 - silent, joint = 3 * living, dead = 3 * silent;
    const double before_s = time_s();
    const auto before = answers(living);
    std::int64_t demand = node(joint).dictionary().get(0x6062), longest = 0;
    for (int i = 0; i < 500; ++i) {
      run(1, {living});
      const std::int64_t next = node(joint).dictionary().get(0x6062);
      longest = std::max(longest, std::abs(next - demand));
      demand = next;
    }
    EXPECT_LE(longest, 150);  // three cycles at most in one
    EXPECT_NEAR(time_s(), before_s + 1, 0.005);
    EXPECT_GE(answers(living), before + 499);
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_EQ(node(joint + i).state(), DriveState::operation_enabled);
      EXPECT_EQ(node(dead + i).state(), DriveState::fault);
      EXPECT_TRUE(node(dead + i).brake_engaged());
      EXPECT_EQ(node(dead + i).dictionary().get(0x6077), 0);
      EXPECT_EQ(node(dead + i).error_code(), 0x8700);
    }
    EXPECT_GE(bench.counters(silent).sync_alone, 490U);
    // And back: both are one cycle again.
    for (std::size_t i = dead; i < dead + 3; ++i) start[i] = node(i).dictionary().get(0x6064) - 50 * k;
    for (std::uint32_t n = 1; n <= 3; ++n)
      for (const std::uint8_t word : {0x80, 0x00}) give(silent, 0x200 + n, {word, 0});
    enable(silent);
    run(30, {a, b});
    for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(node(i).state(), DriveState::operation_enabled) << i;
    const double together_s = time_s();
    pass(cycle_ms);
    sync(a);
    EXPECT_EQ(time_s(), together_s);
    sync(b);
    EXPECT_NEAR(time_s(), together_s + 2e-3, 1e-9);
  }
}

TEST_F(TwoBuses, ALostLinkIsOfItsBusAlone) {
  begin();
  run(50, {a, b});
  link[b] = false;
  run(300, {a, b});
  link[b] = true;
  said[a].clear(), said[b].clear();
  bench.recovered(b, now);
  EXPECT_THAT(said[a], IsEmpty());
  ASSERT_THAT(identifiers(b), ElementsAre(0x81, 0x82, 0x83));
  EXPECT_EQ(said[b][0].data[0] | said[b][0].data[1] << 8, 0x8140);
  for (std::size_t i = 0; i < 6; ++i)
    EXPECT_EQ(node(i).state(), i < 3 ? DriveState::operation_enabled : DriveState::fault) << i;
}

// Whichever SYNC is lost: after a few cycles the SYNCs of one cycle are one again.
TEST_F(TwoBuses, ALostSyncIsSurvived) {
  begin();
  run(20, {a, b});
  for (const std::size_t lost : {a, b, b, a, a}) {
    SCOPED_TRACE(lost);
    pass(cycle_ms);
    sync(1 - lost);
    run(20, {a, b});
    const double before_s = time_s();
    run(20, {a, b});
    EXPECT_NEAR(time_s(), before_s + 0.04, 1e-9);
    sync(a);
    EXPECT_NEAR(time_s(), before_s + 0.04, 1e-9);
    sync(b);
    EXPECT_NEAR(time_s(), before_s + 0.042, 1e-9);
  }
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(node(i).state(), DriveState::operation_enabled) << i;
}

// Nobody commands: reactions end on the clock.
TEST_F(TwoBuses, WithoutAnySyncTheClockEndsTheReaction) {
  begin();
  run(50, {a, b});
  pass(cycle_ms);
  sync(a);  // half a cycle
  pass(1500);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(node(i).state(), DriveState::fault) << i;
    EXPECT_EQ(node(i).dictionary().get(0x6077), 0);
  }
  const double ended_s = time_s();
  pass(1000);
  EXPECT_EQ(time_s(), ended_s);
  // The half cycle from before is forgotten.
  const auto before = answers(a);
  sync(a);
  EXPECT_EQ(answers(a), before + 1);
  EXPECT_EQ(time_s(), ended_s);
  sync(b);
  EXPECT_NEAR(time_s(), ended_s + 2e-3, 1e-9);
}

TEST_F(TwoBuses, InRealTimeNoBusWaits) {
  Bench one{scenario, {.wiring = {{0, 1, 2}, {3, 4, 5}}, .lockstep = false}, send()};
  one.start(now);
  ASSERT_TRUE(one.receive(a, classic(0, std::vector<std::uint8_t>{1, 0}), now));
  said[a].clear();
  for (int i = 0; i < 10; ++i) ASSERT_TRUE(one.receive(a, classic(0x80, {}), now));
  EXPECT_EQ(answers(a), 10);
  EXPECT_EQ(one.plant().twin().time_s(), 0);
}

// Their deadline is shorter: what is kept is kept for less.
TEST_F(TwoBuses, MirrorDrivesDoNotFailForTheOtherBus) {
  int answered = 0, counter = 0;
  const auto count = [&](std::size_t) { ++answered; };
  Bench one{scenario, {.profile = Profile::mirror, .wiring = {{0, 1, 2}, {3, 4, 5}}, .answered = count}, send()};
  one.start(now);
  for (int i = 0; i < 400; ++i) {
    now += ms;
    ASSERT_TRUE(one.tick(now));
    EXPECT_FALSE(one.drives()[0]->failed()) << i;
    if (i % cycle_ms || answered < counter) continue;  // the master waits for its answers
    for (int n = 1; n <= 3; ++n) {
      const MirrorCommand stand{static_cast<std::uint8_t>(counter & 15), MirrorMode::velocity, 0};
      ASSERT_TRUE(one.receive(a, encode(stand, n, MirrorFormat::classic), now));
    }
    ASSERT_TRUE(one.receive(a, classic(0x80, {}), now));
    ++counter;
  }
  EXPECT_TRUE(one.drives()[0]->enabled());
  EXPECT_NEAR(one.plant().twin().time_s(), 0.39, 0.005);
}

}  // namespace
}  // namespace tribotwin::hil
