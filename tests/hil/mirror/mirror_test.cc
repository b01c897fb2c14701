// The plain profile: frames, counters, and what a drive does when commands stop.
#include <cmath>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/hil/mirror/mirror.hpp>
#include <tribotwin/tests/hil/one_drive.hpp>

namespace tribotwin::hil {
namespace {

const DriveParameters parameters{
    .node = 3, .name = "joint3", .gear_ratio = 100, .rated_torque_nm = 2, .speed_max_rad_s = 300};

// The published check value of CRC-8/SAE-J1850 over "123456789" is 4Bh.
TEST(Crc, CheckValue) {
  const std::string text = "123456789";
  EXPECT_EQ(crc8_j1850(std::span(reinterpret_cast<const std::uint8_t*>(text.data()), text.size())) ^ 0xFF, 0x4B);
}

TEST(MirrorFrames, RoundTrip) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> u(-1, 1);
  for (int i = 0; i < 10000; ++i) {
    const MirrorCommand c{static_cast<std::uint8_t>(random() & 15),
                          std::array{MirrorMode::off, MirrorMode::torque, MirrorMode::position, MirrorMode::velocity,
                                     MirrorMode::clear_fault}[random() % 5],
                          1000 * u(random)};
    const auto back = decode_command(encode(c, 3));
    ASSERT_TRUE(back);
    EXPECT_EQ(back->counter, c.counter);
    EXPECT_EQ(back->mode, c.mode);
    EXPECT_NEAR(back->set_point, c.set_point, c.mode == MirrorMode::torque ? 5e-4 : 5e-7);
    const MirrorStatus s{static_cast<std::uint8_t>(random() & 15), MirrorMode::stopping, 80 * u(random), 2 * u(random),
                         100 + 150 * u(random)};
    const auto status = decode_status(encode(s, 3));
    ASSERT_TRUE(status);
    EXPECT_NEAR(status->position_rad, s.position_rad, 5.1e-6);
    EXPECT_NEAR(status->torque_norm, s.torque_norm, 5.1e-4);
    EXPECT_NEAR(status->temperature_degC, s.temperature_degC, 0.051);
  }
  EXPECT_NEAR(decode_status(encode(MirrorStatus{.torque_norm = 99, .temperature_degC = NAN}, 1))->torque_norm, 2.047,
              1e-9);
}

// Every error of one or two bits is found.
TEST(MirrorFrames, DamageIsFound) {
  const Frame good = encode(MirrorCommand{5, MirrorMode::torque, 12.5}, 3);
  for (int a = 0; a < 64; ++a)
    for (int b = a; b < 64; ++b) {
      Frame bad = good;
      bad.data[static_cast<std::size_t>(a / 8)] =
          static_cast<std::uint8_t>(bad.data[static_cast<std::size_t>(a / 8)] ^ 1 << a % 8);
      if (b != a)
        bad.data[static_cast<std::size_t>(b / 8)] =
            static_cast<std::uint8_t>(bad.data[static_cast<std::size_t>(b / 8)] ^ 1 << b % 8);
      EXPECT_FALSE(decode_command(bad)) << a << " " << b;
    }
  Frame other = good;
  other.id = 0x104;  // another drive's
  EXPECT_FALSE(decode_command(other));
}

class Mirror : public testing::Test {
 protected:
  std::vector<Frame> bus;
  MirrorDrive drive{parameters, record_in(bus)};
  std::int64_t now = 0;
  std::uint8_t counter = 0;
  Feedback robot;

  void command(MirrorMode mode, double set_point = 0) {
    drive.receive(encode(MirrorCommand{++counter, mode, set_point}, 3), now);
  }
  void run(int steps) {
    for (int i = 0; i < steps; ++i) {
      now += ms;
      drive.tick(now);
      obey(drive, robot);
    }
  }
};

TEST_F(Mirror, FollowsAndReports) {
  EXPECT_TRUE(drive.brake_engaged());
  for (int k = 1; k <= 50; ++k) {
    command(MirrorMode::position, 0.001 * k);
    run(2);
  }
  EXPECT_NEAR(robot.position_rad, 0.05, 1e-6);
  bus.clear();
  run(100);
  EXPECT_NEAR(static_cast<double>(bus.size()), 50, 1);  // every 2 ms
  const auto status = decode_status(bus.front());
  ASSERT_TRUE(status);
  EXPECT_NEAR(status->position_rad, 0.05, 1e-5);
}

TEST_F(Mirror, RepeatedLostDamagedAndLateAreToldApart) {
  command(MirrorMode::torque, 5);
  const Frame same = encode(MirrorCommand{counter, MirrorMode::torque, 5}, 3);
  drive.receive(same, now);
  counter += 2;
  command(MirrorMode::torque, 5);
  Frame bad = encode(MirrorCommand{++counter, MirrorMode::torque, 500}, 3);
  bad.data[2] ^= 1;
  drive.receive(bad, now);
  EXPECT_EQ(drive.counters().received, 2U);
  EXPECT_EQ(drive.counters().repeated, 1U);
  EXPECT_EQ(drive.counters().lost, 2U);
  EXPECT_EQ(drive.counters().damaged, 1U);
  EXPECT_EQ(drive.command(1e-3).torque_nm, 5);
  run(20);
  EXPECT_EQ(drive.counters().late, 0U);
  EXPECT_EQ(drive.command(1e-3).torque_nm, 5);
  run(1);
  EXPECT_EQ(drive.counters().late, 1U);
  EXPECT_EQ(drive.command(1e-3).torque_nm, 0);  // never the last torque
}

TEST_F(Mirror, ARepeatedFrameKeepsNothingAlive) {
  command(MirrorMode::torque, 5);
  const Frame same = encode(MirrorCommand{counter, MirrorMode::torque, 5}, 3);
  for (int i = 0; i < 30; ++i) {
    drive.receive(same, now);
    run(1);
  }
  EXPECT_EQ(drive.state_name(), "stopping");
}

TEST_F(Mirror, AStopStaysUntilItIsCleared) {
  command(MirrorMode::velocity, 0.5);
  run(25);
  run(500);
  EXPECT_EQ(drive.state_name(), "fault");
  EXPECT_TRUE(drive.brake_engaged());
  command(MirrorMode::torque, 5);
  EXPECT_EQ(drive.state_name(), "fault");
  EXPECT_EQ(drive.command(1e-3).mode, twin::DriveCommand::Mode::off);
  command(MirrorMode::clear_fault);
  EXPECT_EQ(drive.state_name(), "off");
  command(MirrorMode::torque, 5);
  EXPECT_EQ(drive.state_name(), "torque");
  command(MirrorMode::off);
  run(100);
  EXPECT_EQ(drive.state_name(), "off");
}

TEST_F(Mirror, RandomFrames) {
  std::mt19937 random(5);
  for (int i = 0; i < 1'000'000; ++i) {
    Frame f = encode(MirrorCommand{static_cast<std::uint8_t>(random()), static_cast<MirrorMode>(random() & 15),
                                   static_cast<double>(random() % 2000) - 1000},
                     3);
    if (random() % 3 == 0) f.data[random() % 8] = static_cast<std::uint8_t>(random());
    if (random() % 16 == 0) f.size = static_cast<std::uint8_t>(random() % 9);
    drive.receive(f, now);
    if (random() % 8 == 0) run(1);
    const auto c = drive.command(1e-3);
    ASSERT_TRUE(std::isfinite(c.position_rad + c.velocity_rad_s + c.torque_nm));
    if (drive.brake_engaged()) ASSERT_EQ(c.mode, twin::DriveCommand::Mode::off);
    bus.clear();
  }
}

}  // namespace
}  // namespace tribotwin::hil
