// Drives and robot on one imaginary bus.
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/hil/mirror/mirror.hpp>
#include <tribotwin/hil/session/bench.hpp>
#include <tribotwin/tests/hil/one_drive.hpp>

namespace tribotwin::hil {
namespace {

class OneBench : public testing::Test {
 protected:
  twin::Scenario scenario =
      twin::load_scenario(std::string(TRIBOTWIN_SOURCE_DIR) + "/twin/scenarios/irb6620_hold.yaml").value();
  std::vector<Frame> bus;
  std::int64_t now = 0;
  Send send = record_in(bus);

  void give(Bench& bench, std::uint32_t id, std::vector<std::uint8_t> bytes = {}) {
    ASSERT_TRUE(bench.receive(classic(id, bytes), now));
  }
  double position(Bench& bench, std::size_t drive) { return bench.plant().twin().data()->qpos[drive]; }
};

TEST_F(OneBench, EverySyncIsOneCycle) {
  Bench bench(scenario, {.cycle_us = 2000}, send);
  bench.start(now);
  EXPECT_EQ(bus.size(), 6U);
  for (int i = 0; i < 50; ++i) now += 2 * ms, give(bench, 0x80);
  EXPECT_NEAR(bench.plant().twin().time_s(), 0.1, 1e-9);
  EXPECT_EQ(bench.counters().sync_fast, 0U);
  // Twice the rate, or a second master: twice the simulated time, and counted.
  for (int i = 0; i < 100; ++i) now += i % 2 ? 2 * ms - 1000 : 1000, give(bench, 0x80);
  EXPECT_NEAR(bench.plant().twin().time_s(), 0.3, 1e-9);
  EXPECT_EQ(bench.counters().sync_fast, 50U);
  // Frames that resemble a SYNC.
  Frame remote = classic(0x80, {});
  remote.remote = true;
  ASSERT_TRUE(bench.receive(remote, now));
  give(bench, 0x80, {1, 2});
  EXPECT_NEAR(bench.plant().twin().time_s(), 0.3, 1e-9);
}

TEST_F(OneBench, BrakesHoldTheArmUntilDrivesAreEnabled) {
  Bench bench(scenario, {}, send);
  bench.start(now);
  const double before = position(bench, 1);
  for (int i = 0; i < 500; ++i) now += 2 * ms, give(bench, 0x80);
  EXPECT_NEAR(position(bench, 1), before, 1e-5);
}

// Two masters: of two set points before one SYNC the later counts.
TEST_F(OneBench, OfTwoMastersTheLaterCounts) {
  Bench bench(scenario, {}, send);
  bench.start(now);
  give(bench, 0, {1, 0});
  for (const std::uint8_t word : {0x06, 0x07, 0x0F}) give(bench, 0x201, {word, 0});
  auto* node = dynamic_cast<Node*>(bench.drives()[0].get());
  ASSERT_NE(node, nullptr);
  ASSERT_EQ(node->state(), DriveState::operation_enabled);
  const auto here = static_cast<std::int32_t>(node->dictionary().get(0x6064));
  const auto target = [&](std::int32_t counts) {
    std::vector<std::uint8_t> data{0x0F, 0, 0, 0, 0, 0};
    encode(counts, std::span(data).subspan(2));
    give(bench, 0x401, data);
  };
  target(here - 5000);
  target(here + 5000);
  now += 2 * ms;
  give(bench, 0x80);
  EXPECT_EQ(node->dictionary().get(0x607A), here + 5000);
  EXPECT_NEAR(static_cast<double>(node->dictionary().get(0x6062)), here + 5000, 2);
}

TEST_F(OneBench, MirrorDrivesFollow) {
  Bench bench(scenario, {.profile = Profile::mirror, .lockstep = false}, send);
  bench.start(now);
  const double start = position(bench, 3);
  std::uint8_t counter = 0;
  for (int k = 0; k < 500; ++k) {
    now += 2 * ms;
    for (int node = 1; node <= 6; ++node) {
      const auto i = static_cast<std::size_t>(node - 1);
      const double target =
          (node == 4 ? start + 0.1 * (1 - std::cos(M_PI * std::min(1.0, k / 400.0))) : scenario.start_rad[i]);
      ASSERT_TRUE(bench.receive(encode(MirrorCommand{counter, MirrorMode::position, target}, node), now));
    }
    ++counter;
    bench.tick(now);
    for (int step = 0; step < 2; ++step) ASSERT_TRUE(bench.plant().step(bench.drives()));
  }
  EXPECT_NEAR(position(bench, 3), start + 0.2, 5e-3);
  EXPECT_NEAR(position(bench, 1), scenario.start_rad[1], 2e-3);
  const auto status = decode_status(bus.back());
  ASSERT_TRUE(status);
  EXPECT_EQ(status->state, MirrorMode::position);
  // Commands stop: no drive keeps its torque.
  for (int k = 0; k < 1000; ++k) {
    now += ms;
    bench.tick(now);
    ASSERT_TRUE(bench.plant().step(bench.drives()));
  }
  for (const auto& drive : bench.drives()) EXPECT_TRUE(drive->failed());
}

}  // namespace
}  // namespace tribotwin::hil
