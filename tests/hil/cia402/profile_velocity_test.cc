// Profile velocity: ramps, limits and bits.
#include <cmath>
#include <numbers>

#include <tribotwin/tests/hil/cia402/one_node.hpp>

namespace tribotwin::hil {
namespace {

constexpr double per_rad_s = 60e3 * 100 / (2 * std::numbers::pi);
enum Bits : std::uint16_t { reached = 0x0400, limited = 0x0800, stands = 0x1000 };

class ProfileVelocity : public OneNode {
 protected:
  void SetUp() override {
    OneNode::SetUp();
    EXPECT_EQ(write(0x6060, 0, Type::i8, 3), 0U);
    ramp(0x6083, 2);
    ramp(0x6084, 4);
  }
  void ramp(std::uint16_t index, double rad_s2, std::uint8_t sub = 0) {
    EXPECT_EQ(write(index, sub, Type::u32, std::llround(rad_s2 * per_rad_s)), 0U);
  }
  void turn(double rad_s) { EXPECT_EQ(write(0x60FF, 0, Type::i32, std::llround(rad_s * per_rad_s)), 0U); }
  bool is(std::uint16_t bits) { return (status() & bits) == bits; }
};

TEST_F(ProfileVelocity, FollowsItsRamps) {
  turn(1);
  enable();
  run(100);
  EXPECT_EQ(robot.position_rad, 0);  // a speed of before does not turn it
  EXPECT_TRUE(is(reached | stands));
  turn(1);
  run(250);
  EXPECT_NEAR(robot.velocity_rad_s, 0.5, 1e-6);
  EXPECT_FALSE(is(reached));
  EXPECT_FALSE(is(stands));
  run(250);
  EXPECT_NEAR(robot.velocity_rad_s, 1, 1e-6);
  run(12);
  EXPECT_TRUE(is(reached));  // within 606Dh for 10 ms (606Eh)
  turn(-0.5);
  run(250 + 125);
  EXPECT_NEAR(robot.velocity_rad_s, -0.25, 1e-6);
  turn(0);
  run(250);
  EXPECT_EQ(robot.velocity_rad_s, 0);
  EXPECT_TRUE(is(reached | stands));
}

TEST_F(ProfileVelocity, WindowAndThresholdAreOfTheRealSpeed) {
  EXPECT_EQ(write(0x606D, 0, Type::u16, 1000), 0U);
  EXPECT_EQ(write(0x606E, 0, Type::u16, 30), 0U);
  EXPECT_EQ(write(0x606F, 0, Type::u16, 2000), 0U);
  EXPECT_EQ(write(0x6070, 0, Type::u16, 20), 0U);
  enable();
  const auto turns_at = [&](int milli_rpm, int steps) {
    robot.velocity_rad_s = milli_rpm / per_rad_s;
    node.feedback(robot, 1e-3);
    for (int k = 0; k < steps; ++k) node.command(1e-3), node.feedback(robot, 1e-3);
  };
  turns_at(999, 28);
  EXPECT_FALSE(is(reached));
  turns_at(999, 0);
  EXPECT_TRUE(is(reached));
  turns_at(1002, 1);
  EXPECT_FALSE(is(reached));
  turns_at(1999, 100);
  EXPECT_TRUE(is(stands));
  turns_at(2002, 18);
  EXPECT_TRUE(is(stands));
  turns_at(2002, 3);
  EXPECT_FALSE(is(stands));
}

// Entered in motion it stops along 6084h, unless a speed was written for it.
TEST_F(ProfileVelocity, EnteredInMotionItStops) {
  for (const double speed : {0.0, 0.5}) {
    nmt(0x81);
    SetUp();
    robot = {};
    node.feedback(robot, 0);
    EXPECT_EQ(write(0x6060, 0, Type::i8, 8), 0U);
    enable();
    robot.velocity_rad_s = 1;
    node.feedback(robot, 1e-3);
    if (speed > 0) turn(speed);
    EXPECT_EQ(write(0x6060, 0, Type::i8, 3), 0U);
    run(100);
    EXPECT_NEAR(robot.velocity_rad_s, 0.6, 1e-6);
    run(200);
    EXPECT_NEAR(robot.velocity_rad_s, speed, 1e-6);
  }
}

TEST_F(ProfileVelocity, BitsAreThoseOfAHaltedDriveToo) {
  enable();
  turn(1);
  run(600);
  EXPECT_FALSE(is(stands));
  control(0x10F);
  EXPECT_EQ(status() & (reached | stands), 0);
  run(600);
  EXPECT_TRUE(is(reached | stands));
  control(0x0F);
  run(600);
  EXPECT_EQ(status() & (reached | stands), reached);
}

// It brakes in time, and stands at the limit, from every speed and with both ramps; the way back is free.
TEST_F(ProfileVelocity, StopsAtThePositionLimits) {
  for (const int type : {0, 3})
    for (const double speed : {0.02, 0.3, 1.0, 2.5}) {
      SCOPED_TRACE(speed);
      nmt(0x81);
      SetUp();
      EXPECT_EQ(write(0x6086, 0, Type::i16, type), 0U);
      ramp(0x60A4, 30, 1);
      robot = {.position_rad = speed < 0.1 ? 1.99 : 0};
      node.feedback(robot, 0);
      enable();
      for (const int way : {1, -1}) {
        if (way < 0 && speed < 0.1) continue;
        turn(way * speed);
        double hardest = 0, before = robot.velocity_rad_s;
        for (int k = 0; k < 16'000; ++k) {
          run(1);
          ASSERT_LE(way * robot.position_rad, 2 + 1e-3 * speed * 1e-3 + 1e-5);
          hardest = std::max(hardest, std::abs(robot.velocity_rad_s - before));
          before = robot.velocity_rad_s;
        }
        EXPECT_NEAR(way * robot.position_rad, 2, 2e-3 * speed);
        EXPECT_EQ(robot.velocity_rad_s, 0);
        EXPECT_LE(hardest, 4e-3 + 1e-9);
        EXPECT_TRUE(is(limited));
        EXPECT_FALSE(is(reached));
      }
    }
}

TEST_F(ProfileVelocity, TheSpeedIsLimited) {
  struct Row {
    std::uint16_t index;
    double value, speed;
  } rows[] = {{0x607F, std::llround(0.25 * per_rad_s), 0.25}, {0x6080, 100, 100 * 2 * std::numbers::pi / 60 / 100}};
  for (const auto& row : rows) {
    nmt(0x81);
    SetUp();
    robot = {};
    node.feedback(robot, 0);
    enable();
    turn(1);
    run(600);
    EXPECT_NEAR(robot.velocity_rad_s, 1, 1e-6);
    EXPECT_EQ(write(row.index, 0, Type::u32, static_cast<std::int64_t>(row.value)), 0U);
    run(300);
    EXPECT_NEAR(robot.velocity_rad_s, row.speed, 1e-6);
    EXPECT_FALSE(is(reached));
  }
}

TEST_F(ProfileVelocity, NoSetPointIsMissedButTheSyncIs) {
  EXPECT_EQ(write(0x1403, 1, Type::u32, 0x505), 0U);
  enable();
  send(0x505, {0x0F, 0, 0x40, 0x42, 0x0F, 0});
  for (int k = 0; k < 100; ++k) node.sync(now), wait(2), run(2);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  EXPECT_GT(robot.velocity_rad_s, 0.1);
  wait(101);
  EXPECT_EQ(node.error_code(), 0x8700);
}

}  // namespace
}  // namespace tribotwin::hil
