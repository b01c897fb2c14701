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

/// What one count of a format is worth, and how many bytes its frames have.
struct Format {
  MirrorFormat format;
  double position_rad, torque_norm, temperature_degC;
  int command_bytes, status_bytes;
};
class MirrorFrames : public testing::TestWithParam<Format> {};

TEST_P(MirrorFrames, RoundTrip) {
  const Format& f = GetParam();
  std::mt19937 random(1);
  std::uniform_real_distribution<double> u(-1, 1);
  for (int i = 0; i < 10000; ++i) {
    const MirrorCommand c{static_cast<std::uint8_t>(random() & 15),
                          std::array{MirrorMode::off, MirrorMode::torque, MirrorMode::position, MirrorMode::velocity,
                                     MirrorMode::clear_fault}[random() % 5],
                          1000 * u(random), 500 * u(random)};
    const Frame command = encode(c, 3, f.format);
    EXPECT_EQ(command.size, f.command_bytes);
    const auto back = decode_command(command);
    ASSERT_TRUE(back);
    EXPECT_EQ(back->counter, c.counter);
    EXPECT_EQ(back->mode, c.mode);
    EXPECT_NEAR(back->set_point, c.set_point, c.mode == MirrorMode::torque ? 5.1e-4 : 5.1e-7);
    EXPECT_NEAR(back->feed_forward_nm, f.format == MirrorFormat::fd ? c.feed_forward_nm : 0, 5.1e-4);
    const MirrorStatus s{static_cast<std::uint8_t>(random() & 15),
                         MirrorMode::stopping,
                         80 * u(random),
                         2 * u(random),
                         100 + 150 * u(random),
                         3 * u(random)};
    const Frame sent = encode(s, 3, f.format);
    EXPECT_EQ(sent.size, f.status_bytes);
    EXPECT_EQ(sent.fd, f.format == MirrorFormat::fd);
    const auto status = decode_status(sent);
    ASSERT_TRUE(status);
    EXPECT_NEAR(status->position_rad, s.position_rad, 0.51 * f.position_rad);
    EXPECT_NEAR(status->torque_norm, s.torque_norm, 0.51 * f.torque_norm);
    EXPECT_NEAR(status->temperature_degC, s.temperature_degC, 0.51 * f.temperature_degC);
    if (f.format == MirrorFormat::fd) EXPECT_NEAR(status->velocity_rad_s, s.velocity_rad_s, 5.1e-7);
  }
}

INSTANTIATE_TEST_SUITE_P(Formats, MirrorFrames,
                         testing::Values(Format{MirrorFormat::classic, 1e-5, 1e-3, 0.1, 8, 8},
                                         Format{MirrorFormat::fd, 1e-6, 1e-6, 0.01, 12, 16}),
                         [](const auto& info) {
                           return info.param.format == MirrorFormat::classic ? "classic" : "fd";
                         });

TEST(MirrorStatus, Saturates) {
  const auto status = decode_status(encode(MirrorStatus{.torque_norm = 99, .temperature_degC = NAN}, 1));
  EXPECT_NEAR(status->torque_norm, 2.047, 1e-9);
  const auto fd = decode_status(encode(MirrorStatus{.position_rad = 1e9, .torque_norm = -99}, 1, MirrorFormat::fd));
  EXPECT_NEAR(fd->position_rad, 2147.483647, 1e-9);
  EXPECT_NEAR(fd->torque_norm, -8.388608, 1e-9);
}

// Every error of one or two bits is found.
TEST_P(MirrorFrames, DamageIsFound) {
  const Frame good = encode(MirrorCommand{5, MirrorMode::torque, 12.5}, 3, GetParam().format);
  const auto flip = [](Frame& frame, int bit) {
    auto& byte = frame.data[static_cast<std::size_t>(bit / 8)];
    byte = static_cast<std::uint8_t>(byte ^ 1 << bit % 8);
  };
  for (int a = 0; a < 8 * good.size; ++a)
    for (int b = a; b < 8 * good.size; ++b) {
      Frame bad = good;
      flip(bad, a);
      if (b != a) flip(bad, b);
      EXPECT_FALSE(decode_command(bad)) << a << " " << b;
    }
  Frame other = good;
  other.id = 0x104;  // another drive's
  EXPECT_FALSE(decode_command(other));
  other = good;
  other.fd = !other.fd;
  EXPECT_FALSE(decode_command(other)) << "the other format";
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

// FD: the torque of the feed-forward, and only frames of its own format.
TEST(MirrorFd, FollowsItsFormat) {
  std::vector<Frame> bus;
  MirrorDrive drive(parameters, record_in(bus), MirrorFormat::fd);
  drive.receive(encode(MirrorCommand{1, MirrorMode::torque, 5}, 3), 0);
  EXPECT_EQ(drive.state_name(), "off");
  drive.receive(encode(MirrorCommand{1, MirrorMode::velocity, 0.5, 20}, 3, MirrorFormat::fd), 0);
  const auto c = drive.command(1e-3);
  EXPECT_EQ(c.mode, twin::DriveCommand::Mode::velocity);
  EXPECT_NEAR(c.velocity_rad_s, 0.5, 1e-9);
  EXPECT_NEAR(c.torque_nm, 20, 1e-9);
  Feedback robot{.position_rad = 1.234567, .velocity_rad_s = -0.25, .torque_nm = 50, .temperature_degC = 43.21};
  drive.feedback(robot, 1e-3);
  drive.sync(ms);
  const auto status = decode_status(bus.back());
  ASSERT_TRUE(status);
  EXPECT_TRUE(bus.back().fd && bus.back().bit_rate_switch);
  EXPECT_NEAR(status->position_rad, 1.234567, 1e-9);
  EXPECT_NEAR(status->velocity_rad_s, -0.25, 1e-9);
  EXPECT_NEAR(status->torque_norm, 0.25, 1e-9);
  EXPECT_NEAR(status->temperature_degC, 43.21, 1e-9);
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
