// Profile position: what a master writes and reads, and what the joint does.
#include <cmath>
#include <numbers>

#include <tribotwin/tests/hil/cia402/one_node.hpp>

namespace tribotwin::hil {
namespace {

constexpr double per_rad = 65536 * 100 / (2 * std::numbers::pi), per_rad_s = 60e3 * 100 / (2 * std::numbers::pi);
enum Bits : std::uint16_t { reached = 0x0400, limited = 0x0800, acknowledged = 0x1000 };

class ProfilePosition : public OneNode {
 protected:
  void SetUp() override {
    OneNode::SetUp();
    EXPECT_EQ(write(0x6060, 0, Type::i8, 1), 0U);
    speed(0x6081, 1);
    speed(0x6083, 2);
    speed(0x6084, 4);
  }
  /// Speed or acceleration, joint side.
  void speed(std::uint16_t index, double rad_s, std::uint8_t sub = 0) {
    EXPECT_EQ(write(index, sub, Type::u32, std::llround(rad_s * per_rad_s)), 0U);
  }
  void aim(double rad) { EXPECT_EQ(write(0x607A, 0, Type::i32, std::llround(rad * per_rad)), 0U); }
  void start(std::uint16_t bits = 0) {
    control(0x0F);
    control(0x1F | bits);
  }
  void go(double rad, std::uint16_t bits = 0) {
    aim(rad);
    start(bits);
  }
  bool is(std::uint16_t bits) { return (status() & bits) == bits; }
  /// Steps until the demand stands still; the fastest speed on the way.
  double settle(int most = 20'000) {
    double fastest = 0;
    int steps = 0;
    do {
      run(1);
      fastest = std::max(fastest, std::abs(robot.velocity_rad_s));
    } while (robot.velocity_rad_s != 0 && ++steps < most);
    EXPECT_LT(steps, most);
    run(20);
    return fastest;
  }
};

// Rest to rest: the time of a trapezoid, 1 / v + v / 2a + v / 2d, and bits 12 and 10 on the way.
TEST_F(ProfilePosition, ASetPointIsTakenAtTheEdgeOfBit4) {
  EXPECT_EQ(write(0x6067, 0, Type::u32, 0), 0U);
  enable();
  run(20);
  EXPECT_TRUE(is(reached));
  aim(1);
  run(50);
  EXPECT_EQ(robot.position_rad, 0);
  control(0x1F);
  EXPECT_TRUE(is(acknowledged));
  EXPECT_FALSE(is(reached));
  control(0x0F);
  EXPECT_FALSE(is(acknowledged));
  run(1370);
  EXPECT_NEAR(robot.position_rad, 1, 1e-4);
  EXPECT_GT(std::abs(robot.velocity_rad_s), 0);
  run(10);
  EXPECT_EQ(robot.velocity_rad_s, 0);
  EXPECT_NEAR(robot.position_rad, std::llround(per_rad) / per_rad, 1e-12);
  EXPECT_FALSE(is(reached));  // 10 ms within the window (6068h)
  run(10);
  EXPECT_TRUE(is(reached));
  EXPECT_EQ(node.dictionary().get(0x6062), std::llround(per_rad));
}

// The position comes behind the controlword in RPDO3, and still belongs to it.
TEST_F(ProfilePosition, ATargetInTheSamePdoIsTheOneThatIsTaken) {
  enable();
  std::vector<std::uint8_t> data{0x1F, 0, 0, 0, 0, 0};
  encode(std::llround(0.5 * per_rad), std::span(data).subspan(2));
  send(0x405, data);
  node.sync(now);
  settle();
  EXPECT_NEAR(robot.position_rad, 0.5, 1e-6);
}

// A set point is needed once; but a master that brings it with every SYNC is missed when it stops.
TEST_F(ProfilePosition, OnlyACyclicMasterIsMissed) {
  const auto cycles = [&](int count, bool set_points) {
    for (int k = 0; k < count; ++k) {
      if (set_points) send(0x405, {0x0F, 0, 0, 0, 0, 0});
      wait(2);
      node.sync(now);
    }
  };
  enable();
  for (const int few : {1, 3, 20}) {
    cycles(few, true);
    cycles(500, false);
    ASSERT_EQ(node.state(), DriveState::operation_enabled) << few;
  }
  cycles(21, true);
  cycles(20, false);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  cycles(1, false);
  EXPECT_EQ(node.state(), DriveState::fault_reaction_active);
}

TEST_F(ProfilePosition, EnablingAndOldTargetsDoNotMoveTheArm) {
  aim(1);
  nmt(1);
  for (const std::uint16_t word : {0x06, 0x07, 0x1F}) control(word);
  run(100);
  EXPECT_EQ(robot.position_rad, 0);
  EXPECT_FALSE(is(acknowledged));
  start();  // but it is still there, for masters that write it before they enable
  settle();
  EXPECT_NEAR(robot.position_rad, 1, 1e-6);
  // A position for this mode is none for the next.
  aim(-1);
  EXPECT_EQ(write(0x6060, 0, Type::i8, 8), 0U);
  node.sync(now);
  run(100);
  EXPECT_NEAR(robot.position_rad, 1, 1e-6);
}

TEST_F(ProfilePosition, OneSetPointWaits) {
  enable();
  go(0.5);
  control(0x0F);
  go(-0.25);
  EXPECT_TRUE(is(acknowledged));
  control(0x0F);
  EXPECT_TRUE(is(acknowledged));  // no room for another one
  go(1.5);                        // which is not taken
  control(0x0F);
  while (robot.velocity_rad_s >= 0) run(1);
  EXPECT_NEAR(robot.position_rad, 0.5, 1e-3);
  EXPECT_FALSE(is(acknowledged));
  settle();
  EXPECT_NEAR(robot.position_rad, -0.25, 1e-6);
  EXPECT_TRUE(is(reached));
}

// A set point that comes within the window starts at once; bit 10 does not speak of one before it.
TEST_F(ProfilePosition, ReachedIsOfTheLastSetPoint) {
  EXPECT_EQ(write(0x6067, 0, Type::u32, 20000), 0U);
  EXPECT_EQ(write(0x6068, 0, Type::u16, 1), 0U);
  enable();
  go(0.5);
  while (!is(reached)) run(1);
  EXPECT_GT(robot.velocity_rad_s, 0);
  go(1);
  EXPECT_FALSE(is(reached));
  control(0x0F);
  EXPECT_FALSE(is(acknowledged));
  run(100);
  go(1.5);  // this one waits
  while (robot.position_rad < 1 - 1e-5) {
    run(1);
    ASSERT_FALSE(is(reached));
  }
  settle();
  EXPECT_TRUE(is(reached));
  EXPECT_NEAR(robot.position_rad, 1.5, 1e-6);
}

// With its end speed the first set point is passed without a stop.
TEST_F(ProfilePosition, AnEndSpeedIsForTheSetPointThatWaits) {
  enable();
  speed(0x6082, 0.5);
  go(0.5);
  speed(0x6082, 0);
  go(1);
  while (robot.position_rad < 0.499) run(1);
  EXPECT_NEAR(robot.velocity_rad_s, 0.5, 0.02);
  run(1);
  EXPECT_GT(robot.velocity_rad_s, 0.49);
  settle();
  EXPECT_NEAR(robot.position_rad, 1, 1e-6);
  // Without one it stops beyond, along 6084h: v^2 / 2d.
  speed(0x6082, 0.5);
  go(0);
  settle();
  EXPECT_NEAR(robot.position_rad, -0.25 / 8, 1e-6);
  EXPECT_TRUE(is(reached));
}

// The way of the stop behind the target counts against 607Dh, too.
TEST_F(ProfilePosition, AnEndSpeedDoesNotLeadBeyondTheLimits) {
  enable();
  for (const int ramp : {0, 3})
    for (const double goal : {1.95, 2.0, 5.0, -1.95, -2.0}) {
      SCOPED_TRACE(goal);
      EXPECT_EQ(write(0x6086, 0, Type::i16, ramp), 0U);
      speed(0x6082, 1);
      go(goal);
      settle();
      EXPECT_LE(std::abs(robot.position_rad), 2 + 1e-4);
      EXPECT_GE(std::abs(robot.position_rad), 1.95 - 1e-4);
    }
}

// Entered in motion the drive stops first; a set point waits for that, also over a halt.
TEST_F(ProfilePosition, AHaltKeepsTheSetPointThatWaitsForTheStop) {
  enable();
  go(1);
  run(500);
  EXPECT_EQ(write(0x6060, 0, Type::i8, 3), 0U);
  EXPECT_EQ(write(0x6060, 0, Type::i8, 1), 0U);
  run(10);
  ASSERT_GT(robot.velocity_rad_s, 0.5);
  go(-0.5);
  EXPECT_TRUE(is(acknowledged));
  control(0x11F);
  run(5);
  control(0x1F);
  EXPECT_TRUE(is(acknowledged));  // bit 4 has not fallen
  control(0x0F);
  settle();
  EXPECT_NEAR(robot.position_rad, -0.5, 1e-6);
  EXPECT_FALSE(is(acknowledged));
}

TEST_F(ProfilePosition, Bit5ChangesAtOnceAndForgetsWhatWaits) {
  enable();
  go(1);
  go(-1);
  run(300);
  EXPECT_GT(robot.velocity_rad_s, 0.5);
  go(0.1, 0x20);
  settle();
  EXPECT_NEAR(robot.position_rad, 0.1, 1e-6);
  EXPECT_TRUE(is(reached));
}

TEST_F(ProfilePosition, Bit6CountsFromTheSetPointBefore) {
  robot.position_rad = 0.25;
  node.feedback(robot, 0);
  enable();
  go(0.5, 0x40);
  go(0.25, 0x40);
  settle();
  while (!is(reached)) run(1);
  EXPECT_NEAR(robot.position_rad, 1, 1e-6);
  go(-0.5, 0x60);
  run(100);
  go(-0.5, 0x60);  // from the set point, not from where the joint is
  settle();
  EXPECT_NEAR(robot.position_rad, 0, 1e-6);
}

// The highest speed and acceleration of a move, joint side.
TEST_F(ProfilePosition, WhatLimitsSpeedAndAcceleration) {
  struct Row {
    std::uint16_t index;
    double value, speed, acceleration;
  } rows[] = {{0x6081, 0.5, 0.5, 2}, {0x607F, 0.4, 0.4, 2}, {0x6083, 1, 1, 4}, {0x60C5, 0.5, 0.8165, 4}};
  for (const auto& row : rows) {
    SCOPED_TRACE(row.index);
    nmt(0x81);
    SetUp();
    robot = {};
    node.feedback(robot, 0);
    enable();
    speed(row.index, row.value);
    go(0.75);
    double fastest = 0, before = 0, hardest = 0;
    for (int k = 0; k < 5000; ++k) {
      run(1);
      fastest = std::max(fastest, robot.velocity_rad_s);
      if (robot.velocity_rad_s > before) hardest = std::max(hardest, robot.velocity_rad_s - before);
      before = robot.velocity_rad_s;
    }
    EXPECT_NEAR(fastest, row.speed, 2e-3);
    EXPECT_NEAR(hardest, 1e-3 * std::min(row.index == 0x6083 || row.index == 0x60C5 ? row.value : 2.0, 4.0), 1e-6);
    EXPECT_NEAR(robot.position_rad, 0.75, 1e-6);
  }
}

// 6080h counts in every mode, also when it changes on the way: 10 rpm of the motor.
TEST_F(ProfilePosition, TheMaximumMotorSpeedMayFallOnTheWay) {
  enable();
  go(1.5);
  run(700);
  EXPECT_NEAR(robot.velocity_rad_s, 1, 1e-3);
  EXPECT_EQ(write(0x6080, 0, Type::u32, 100), 0U);
  const double limit = 100 * 2 * std::numbers::pi / 60 / 100;
  run(static_cast<int>(1e3 * (1 - limit) / 4) + 2);
  EXPECT_NEAR(robot.velocity_rad_s, limit, 1e-9);
  settle();
  EXPECT_NEAR(robot.position_rad, 1.5, 1e-6);
}

TEST_F(ProfilePosition, SoftLimitsCutATarget) {
  enable();
  go(3);
  settle();
  EXPECT_NEAR(robot.position_rad, 2, 1e-4);
  EXPECT_TRUE(is(reached | limited));
  go(1);
  EXPECT_FALSE(is(limited));
}

// 6086h = 3: the acceleration has steps of at most the jerk.
TEST_F(ProfilePosition, JerkLimitedRamps) {
  EXPECT_EQ(write(0x6086, 0, Type::i16, 3), 0U);
  speed(0x60A4, 20, 1);
  enable();
  go(1);
  double speed_before = 0, acceleration_before = 0, jerk = 0;
  for (int k = 0; k < 3000; ++k) {
    run(1);
    const double acceleration = (robot.velocity_rad_s - speed_before) / 1e-3;
    jerk = std::max(jerk, std::abs(acceleration - acceleration_before) / 1e-3);
    speed_before = robot.velocity_rad_s;
    acceleration_before = acceleration;
  }
  EXPECT_NEAR(jerk, 20, 0.01);
  EXPECT_NEAR(robot.position_rad, 1, 1e-6);
  EXPECT_EQ(write(0x6086, 0, Type::i16, 1), 0x06090030U);
  EXPECT_EQ(write(0x6086, 0, Type::i16, 4), 0x06090031U);
}

// A smaller jerk on the way would need a higher speed to end the acceleration: the speed counts more.
TEST_F(ProfilePosition, ASmallerJerkDoesNotRaiseTheSpeed) {
  EXPECT_EQ(write(0x6086, 0, Type::i16, 3), 0U);
  speed(0x60A4, 1000, 1);
  enable();
  go(1.8);
  run(300);
  EXPECT_NEAR(robot.velocity_rad_s, 0.6, 0.01);
  speed(0x60A4, 1, 1);
  go(1.9, 0x20);
  EXPECT_LE(settle(), 1 + 1e-6);
}

TEST_F(ProfilePosition, AHaltKeepsTheSetPoint) {
  enable();
  go(1);
  run(500);
  control(0x11F);
  run(400);
  EXPECT_EQ(robot.velocity_rad_s, 0);
  EXPECT_TRUE(is(reached));  // at rest
  const double here = robot.position_rad;
  EXPECT_LT(here, 0.6);
  run(100);
  EXPECT_EQ(robot.position_rad, here);
  control(0x1F);
  EXPECT_FALSE(is(reached));
  settle();
  EXPECT_NEAR(robot.position_rad, 1, 1e-6);
}

// The window of the real position, not of the demand; without one the end of the ramp counts.
TEST_F(ProfilePosition, TargetReachedIsTheRealPosition) {
  EXPECT_EQ(write(0x6067, 0, Type::u32, 100), 0U);
  EXPECT_EQ(write(0x6068, 0, Type::u16, 50), 0U);
  enable();
  go(1);
  settle();
  run(100);
  EXPECT_TRUE(is(reached));
  robot.position_rad += 101 / per_rad;
  for (int k = 0; k < 2; ++k) node.feedback(robot, 1e-3), node.command(1e-3);
  node.feedback(robot, 1e-3);
  EXPECT_FALSE(is(reached));
  robot.position_rad -= 2 / per_rad;
  for (int k = 0; k < 49; ++k) node.command(1e-3), node.feedback(robot, 1e-3);
  EXPECT_FALSE(is(reached));
  for (int k = 0; k < 2; ++k) node.command(1e-3), node.feedback(robot, 1e-3);
  EXPECT_TRUE(is(reached));
  EXPECT_EQ(write(0x6067, 0, Type::u32, 0xffffffff), 0U);
  robot.position_rad += 0.01;
  for (int k = 0; k < 52; ++k) node.command(1e-3), node.feedback(robot, 1e-3);
  EXPECT_TRUE(is(reached));
}

// A set point is sent once: only SYNC and heartbeat are watched.
TEST_F(ProfilePosition, NoSetPointIsMissedButTheSyncIs) {
  enable();
  std::vector<std::uint8_t> data{0x1F, 0, 0, 0x10, 0, 0};
  send(0x405, data);
  for (int k = 0; k < 1000; ++k) node.sync(now), wait(2), run(2);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  wait(101);
  EXPECT_EQ(node.error_code(), 0x8700);
}

// A drive that turns already brakes along 6084h when it enters the mode.
TEST_F(ProfilePosition, EnteredInMotionItStops) {
  EXPECT_EQ(write(0x6060, 0, Type::i8, 9), 0U);
  enable();
  EXPECT_EQ(write(0x60FF, 0, Type::i32, std::llround(1 * per_rad_s)), 0U);
  run(200);
  EXPECT_NEAR(robot.velocity_rad_s, 1, 1e-6);
  const double here = robot.position_rad;
  EXPECT_EQ(write(0x6060, 0, Type::i8, 1), 0U);
  settle();
  EXPECT_NEAR(robot.position_rad, here + 1. / 8, 1e-6);
}

}  // namespace
}  // namespace tribotwin::hil
