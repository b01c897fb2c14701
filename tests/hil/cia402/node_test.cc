// One drive on a simulated bus: frames in, frames out, and a clock that the test sets.
#include <cmath>
#include <numbers>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/hil/canopen/budget.hpp>
#include <tribotwin/hil/canopen/dbc.hpp>
#include <tribotwin/hil/canopen/eds.hpp>
#include <tribotwin/hil/cia402/node.hpp>
#include <tribotwin/tests/hil/cia402/one_node.hpp>

namespace tribotwin::hil {
namespace {

TEST_F(OneNode, BootsAndBeats) {
  Node fresh(parameters, record_in(bus));
  fresh.start(0);
  ASSERT_EQ(bus.size(), 1U);
  EXPECT_EQ(text(bus[0]), "705#00");
  fresh.tick(500 * ms);
  EXPECT_EQ(text(bus.back()), "705#7F");
  fresh.receive(classic(0, std::vector<std::uint8_t>{1, 0}), 600 * ms);
  fresh.tick(1000 * ms);
  EXPECT_EQ(text(on(0x705).back()), "705#05");
}

using S = DriveState;

StateMachine in(S state) {
  StateMachine m;
  const StopOptions at_once{.quick_stop = 6, .disable_operation = 0};
  if (state == S::ready_to_switch_on || state == S::switched_on || state == S::operation_enabled ||
      state == S::quick_stop_active)
    m.controlword(0x06, at_once);
  if (state == S::switched_on || state == S::operation_enabled || state == S::quick_stop_active)
    m.controlword(0x07, at_once);
  if (state == S::operation_enabled || state == S::quick_stop_active) m.controlword(0x0F, at_once);
  if (state == S::quick_stop_active) m.controlword(0x02, at_once);
  if (state == S::fault) m.fail(false);
  EXPECT_EQ(m.state(), state);
  return m;
}

// CiA 402, every transition that has a command, and that no other command moves the drive.
TEST(StateMachine, ToTheLetter) {
  struct Row {
    S from;
    std::uint16_t word;
    S to;
  } rows[] = {{S::switch_on_disabled, 0x06, S::ready_to_switch_on},
              {S::switch_on_disabled, 0x07, S::switch_on_disabled},
              {S::switch_on_disabled, 0x0F, S::switch_on_disabled},
              {S::switch_on_disabled, 0x00, S::switch_on_disabled},
              {S::switch_on_disabled, 0x02, S::switch_on_disabled},
              {S::ready_to_switch_on, 0x07, S::switched_on},
              {S::ready_to_switch_on, 0x0F, S::operation_enabled},
              {S::ready_to_switch_on, 0x00, S::switch_on_disabled},
              {S::ready_to_switch_on, 0x02, S::switch_on_disabled},
              {S::ready_to_switch_on, 0x06, S::ready_to_switch_on},
              {S::switched_on, 0x0F, S::operation_enabled},
              {S::switched_on, 0x06, S::ready_to_switch_on},
              {S::switched_on, 0x00, S::switch_on_disabled},
              {S::switched_on, 0x02, S::switch_on_disabled},
              {S::operation_enabled, 0x07, S::switched_on},
              {S::operation_enabled, 0x06, S::ready_to_switch_on},
              {S::operation_enabled, 0x00, S::switch_on_disabled},
              {S::operation_enabled, 0x02, S::quick_stop_active},
              {S::operation_enabled, 0x0F, S::operation_enabled},
              {S::quick_stop_active, 0x00, S::switch_on_disabled},
              {S::quick_stop_active, 0x0F, S::operation_enabled},
              {S::quick_stop_active, 0x06, S::quick_stop_active},
              {S::fault, 0x80, S::switch_on_disabled},
              {S::fault, 0x0F, S::fault},
              {S::fault, 0x00, S::fault},
              {S::fault, 0x06, S::fault}};
  for (const auto& row : rows) {
    StateMachine m = in(row.from);
    m.controlword(row.word, {.quick_stop = 6, .disable_operation = 0});
    EXPECT_EQ(m.state(), row.to) << name_of(row.from) << fmt::format(" {:02X}", row.word);
  }
}

TEST(StateMachine, FaultResetIsAnEdgeNotALevel) {
  StateMachine m = in(S::ready_to_switch_on);
  m.controlword(0x87, {});
  m.fail(false);
  m.controlword(0x80, {});
  EXPECT_EQ(m.state(), S::fault);
  m.controlword(0x00, {});
  m.controlword(0x80, {});
  EXPECT_EQ(m.state(), S::switch_on_disabled);
}

// Disable operation stays enabled until the motor stands; quick stop option 2 goes on by itself.
TEST(StateMachine, RampsEndWhenTheMotorStands) {
  StateMachine m = in(S::operation_enabled);
  m.controlword(0x07, {.disable_operation = 1});
  EXPECT_EQ(m.state(), S::operation_enabled);
  EXPECT_FALSE(m.follows());
  m.stopped();
  EXPECT_EQ(m.state(), S::switched_on);
  m = in(S::operation_enabled);
  m.controlword(0x02, {.quick_stop = 2});
  m.stopped();
  EXPECT_EQ(m.state(), S::switch_on_disabled);
  m = in(S::operation_enabled);
  m.fail(true);
  EXPECT_EQ(m.state(), S::fault_reaction_active);
  m.controlword(0x80, {});
  EXPECT_EQ(m.state(), S::fault_reaction_active);
  m.stopped();
  EXPECT_EQ(m.state(), S::fault);
}

TEST_F(OneNode, StatuswordsOfEveryState) {
  nmt(1);
  EXPECT_EQ(status() & 0x4F, 0x40);
  control(0x06);
  EXPECT_EQ(status() & 0x6F, 0x21);
  control(0x07);
  EXPECT_EQ(status() & 0x6F, 0x23);
  EXPECT_TRUE(node.brake_engaged());
  control(0x0F);
  EXPECT_EQ(status() & 0x6F, 0x27);
  EXPECT_EQ(status() & 0x1200, 0x1200);  // remote, follows
  EXPECT_FALSE(node.brake_engaged());
  control(0x02);
  EXPECT_EQ(status() & 0x6F, 0x07);
  run(100);
  EXPECT_EQ(status() & 0x4F, 0x40);
  EXPECT_TRUE(node.brake_engaged());
  node.fail(0x1000, 1, false, now);
  EXPECT_EQ(status() & 0x4F, 0x08);
}

TEST_F(OneNode, EnablingDoesNotMoveTheArm) {
  robot.position_rad = 0.7;
  node.feedback(robot, 0);
  send(0x405, {0x06, 0, 0, 0, 0, 0});  // a target of 0, long before
  enable();
  const auto c = node.command(1e-3);
  EXPECT_EQ(c.mode, twin::DriveCommand::Mode::position);
  EXPECT_NEAR(c.position_rad, 0.7, 1e-6);
  EXPECT_EQ(c.velocity_rad_s, 0);
}

// A target that comes with one SYNC is reached along a straight line at the next.
TEST_F(OneNode, CspInterpolatesOverTheCycle) {
  enable();
  const double counts_per_rad = 65536 * 100 / (2 * std::numbers::pi);
  for (int k = 1; k <= 10; ++k) {
    const auto target = static_cast<std::int32_t>(std::lround(0.001 * k * counts_per_rad));
    std::vector<std::uint8_t> data{0x0F, 0, 0, 0, 0, 0};
    encode(target, std::span(data).subspan(2));
    send(0x405, data);
    node.sync(now);
    const auto c = node.command(1e-3);
    EXPECT_NEAR(c.position_rad, 0.001 * (k - 0.5), 2e-6) << k;
    EXPECT_NEAR(c.velocity_rad_s, 0.5, 1e-3);
    EXPECT_NEAR(node.command(1e-3).position_rad, 0.001 * k, 2e-6);
  }
  node.sync(now);  // no new target: it stands there
  run(5);
  EXPECT_NEAR(robot.position_rad, 0.01, 2e-6);
  EXPECT_NEAR(robot.velocity_rad_s, 0, 1e-9);
}

TEST_F(OneNode, TargetsBeyondTheLimitsAreHeld) {
  enable();
  std::vector<std::uint8_t> data{0x0F, 0, 0xff, 0xff, 0xff, 0x7f};
  for (int k = 0; k < 4000; ++k) {
    send(0x405, data);
    node.sync(now);
    run(2);
    ASSERT_LE(std::abs(robot.velocity_rad_s), 3.001);  // 6080h: 300 rad/s at the motor
  }
  EXPECT_NEAR(robot.position_rad, 2, 1e-4);
}

TEST_F(OneNode, ModesCsvAndCst) {
  enable();
  EXPECT_EQ(write(0x60FF, 0, Type::i32, 60000), 0U);  // 60 rpm at the motor
  EXPECT_EQ(write(0x6060, 0, Type::i8, 9), 0U);
  EXPECT_EQ(node.dictionary().get(0x6061), 9);
  auto c = node.command(1e-3);
  EXPECT_EQ(c.mode, twin::DriveCommand::Mode::velocity);
  EXPECT_NEAR(c.velocity_rad_s, 2 * std::numbers::pi / 100, 1e-9);
  EXPECT_EQ(write(0x6071, 0, Type::i16, -500), 0U);
  EXPECT_EQ(write(0x6060, 0, Type::i8, 10), 0U);
  c = node.command(1e-3);
  EXPECT_EQ(c.mode, twin::DriveCommand::Mode::torque);
  EXPECT_NEAR(c.torque_nm, -100, 1e-9);
  EXPECT_NEAR(c.torque_limit_nm, 200, 1e-9);
  for (const int profile : {2, 4, 5}) EXPECT_EQ(write(0x6060, 0, Type::i8, profile), 0x06090030U) << profile;
  EXPECT_EQ(write(0x6060, 0, Type::i8, -1), 0x06090032U);
  EXPECT_EQ(write(0x6060, 0, Type::i8, 11), 0x06090031U);
}

// 6060h = 0, "no mode", as ros2_canopen writes it at shutdown: the drive stands, and takes up the next mode there.
TEST_F(OneNode, WithoutAModeItStands) {
  EXPECT_EQ(write(0x6060, 0, Type::i8, 0), 0U);
  EXPECT_EQ(node.dictionary().get(0x6061), 0);
  enable();
  run(10);
  EXPECT_EQ(robot.velocity_rad_s, 0);
  EXPECT_EQ(write(0x60FF, 0, Type::i32, 95493), 0U);
  run(10);
  EXPECT_EQ(robot.velocity_rad_s, 0);
  EXPECT_EQ(write(0x6060, 0, Type::i8, 9), 0U);
  EXPECT_EQ(write(0x60FF, 0, Type::i32, 95493), 0U);
  run(10);
  EXPECT_NEAR(robot.velocity_rad_s, 0.1, 1e-4);
  EXPECT_EQ(write(0x6060, 0, Type::i8, 0), 0U);
  EXPECT_EQ(node.dictionary().get(0x6061), 0);
  EXPECT_EQ(status() & 0x1000, 0);
  run(2000);
  EXPECT_EQ(robot.velocity_rad_s, 0);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  node.sync(now);
  EXPECT_EQ(write(0x6060, 0, Type::i8, 9), 0U);
  EXPECT_EQ(node.dictionary().get(0x60FF), 0);
  nmt(0x81);
  EXPECT_EQ(node.dictionary().get(0x6061), 8);
}

// A refused value in an RPDO is reported once, not with every frame.
TEST_F(OneNode, AnUnsupportedModeByPdoIsReported) {
  enable();
  for (int k = 0; k < 10; ++k) send(0x305, {0x0F, 0, 4});
  ASSERT_EQ(on(0x085).size(), 2U);
  EXPECT_EQ(text(on(0x085)[0]), "085#2063216060000400");  // parameter error; 6060h:00, value 4
  EXPECT_EQ(text(on(0x085)[1]), "085#0000000000000000");
  EXPECT_EQ(node.dictionary().get(0x6060), 8);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  send(0x305, {0x0F, 0, 9});
  EXPECT_EQ(node.dictionary().get(0x6061), 9);
  send(0x305, {0x0F, 0, 4});
  EXPECT_EQ(on(0x085).size(), 4U);
}

// The modes are defined in one table only.
TEST_F(OneNode, EveryModeOfTheTableWorks) {
  std::vector<std::string> names;
  for (const ModeOfOperation& mode : modes_of_operation()) {
    SCOPED_TRACE(mode.name);
    names.push_back(fmt::format("{} {}", mode.number, mode.name));
    if (mode.target != 0) {
      const auto target = std::ranges::find(targets(), mode.target, &Target::index);
      ASSERT_NE(target, targets().end());
      EXPECT_EQ(node.dictionary().find(target->index, target->sub)->access, Access::read_write);
    }
    for (const auto index : mode.needs) EXPECT_TRUE(index == 0 || node.dictionary().has_index(index));
    EXPECT_NE(node.dictionary().get(0x6502) & (1 << (mode.number - 1)), 0);
    nmt(0x81);
    EXPECT_EQ(write(0x6060, 0, Type::i8, mode.number), 0U);
    enable();
    EXPECT_EQ(node.dictionary().get(0x6061), mode.number);
    EXPECT_NE(node.command(1e-3).mode, twin::DriveCommand::Mode::off);
  }
  EXPECT_THAT(names, testing::ElementsAre("1 PP", "3 PV", "6 HM", "7 IP", "8 CSP", "9 CSV", "10 CST"));
  EXPECT_EQ(node.dictionary().get(0x6502), 0x3E5);
}

// Lost commands: after one deadline the torque is the reaction's, and it stays so until a fault reset.
TEST_F(OneNode, ALatePdoTakesThePower) {
  for (const int option : {1, 2, 3}) {
    SCOPED_TRACE(option);
    nmt(0x81);
    EXPECT_EQ(write(0x1404, 1, Type::u32, 0x80000000), 0U);
    EXPECT_EQ(write(0x6007, 0, Type::i16, option), 0U);
    EXPECT_EQ(write(0x1402, 5, Type::u16, 10), 0U);
    EXPECT_EQ(write(0x2120, 1, Type::u16, 60000), 0U);
    EXPECT_EQ(write(0x6060, 0, Type::i8, 10), 0U);
    enable();
    EXPECT_EQ(write(0x6071, 0, Type::i16, 700), 0U);
    send(0x405, {0x0F, 0, 0, 0, 0, 0});
    node.sync(now);
    EXPECT_GT(node.command(1e-3).torque_nm, 0);
    wait(10);
    EXPECT_EQ(node.state(), DriveState::operation_enabled);
    bus.clear();
    wait(1);
    EXPECT_EQ(on(0x085).size(), 1U);
    EXPECT_EQ(text(on(0x085).at(0)).substr(0, 8), "085#5082");
    EXPECT_EQ(node.command(1e-3).torque_nm, 0);
    EXPECT_EQ(node.state(), option == 2 ? DriveState::fault : DriveState::fault_reaction_active);
    send(0x405, {0x0F, 0, 0, 0, 0, 0});  // the master is back, but the fault stays
    node.sync(now);
    run(100);
    EXPECT_EQ(node.state(), DriveState::fault);
    EXPECT_TRUE(node.brake_engaged());
    EXPECT_EQ(node.command(1e-3).mode, twin::DriveCommand::Mode::off);
    control(0x80);
    EXPECT_EQ(node.state(), DriveState::switch_on_disabled);
  }
}

TEST_F(OneNode, ALostHeartbeatTakesThePower) {
  EXPECT_EQ(write(0x1016, 1, Type::u32, 0x7F << 16 | 50), 0U);
  enable();
  wait(200);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);  // watched from its first beat on
  send(0x77F, {5});
  wait(50);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  bus.clear();
  wait(1);
  EXPECT_EQ(text(on(0x085).at(0)).substr(0, 8), "085#3081");
  EXPECT_EQ(node.nmt(), Nmt::pre_operational);  // 1029h
  EXPECT_EQ(node.state(), DriveState::fault_reaction_active);
  run(100);
  EXPECT_EQ(node.state(), DriveState::fault);
}

TEST_F(OneNode, AStoppedSyncTakesThePower) {
  enable();
  node.sync(now);
  wait(2);
  node.sync(now);
  wait(100);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  wait(1);
  EXPECT_EQ(node.state(), DriveState::fault_reaction_active);
  EXPECT_EQ(node.error_code(), 0x8700);
}

// The deadline of the SYNC is at least three cycles (1006h), whatever 2120h says.
TEST_F(OneNode, TheSyncDeadlineFollowsTheCycle) {
  EXPECT_EQ(write(0x1006, 0, Type::u32, 200'000), 0U);
  enable();
  for (int k = 0; k < 10; ++k) node.sync(now), wait(200);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  wait(400);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  wait(1);
  EXPECT_EQ(node.error_code(), 0x8700);
}

// A SYNC slower than 2120h in a mode without cyclic set points: three of its own periods, from the third SYNC on.
TEST_F(OneNode, ASlowButSteadySyncIsWatched) {
  const struct {
    std::vector<std::int64_t> periods_ms;
    std::int64_t lost_after_ms;  // 0: it is no cycle
  } rows[] = {{{200, 200}, 600},       {{150, 300}, 900},    {{101, 150, 200, 590, 400, 300}, 1200},
              {{1000, 1000}, 3000},    {{200}, 0},           {{150, 301}, 0},
              {{1001, 1001, 1001}, 0}, {{200, 200, 50}, 100}};
  for (const std::int64_t mode : {1, 3, 6})
    for (const auto& row : rows) {
      SCOPED_TRACE(testing::Message() << "mode " << mode << ", " << testing::PrintToString(row.periods_ms));
      nmt(0x81);
      EXPECT_EQ(write(0x6060, 0, Type::i8, mode), 0U);
      enable();
      node.sync(now);
      for (const std::int64_t period : row.periods_ms) wait(period), node.sync(now);
      wait(row.lost_after_ms > 0 ? row.lost_after_ms : 10'000);
      EXPECT_EQ(node.state(), DriveState::operation_enabled);
      wait(1);
      EXPECT_EQ(node.error_code(), row.lost_after_ms > 0 ? 0x8700 : 0);
      EXPECT_GT(node.next_ns(), now);
    }
}

TEST_F(OneNode, AStrayIsNotAWatchedSync) {
  EXPECT_EQ(write(0x6060, 0, Type::i8, 9), 0U);
  enable();
  node.sync(now);
  for (int k = 0; k < 100; ++k) {
    EXPECT_EQ(write(0x60FF, 0, Type::i32, 1000 + k), 0U);
    wait(10);
  }
  node.sync(now);  // another one, a second later
  wait(1000);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  // One SYNC is enough where it takes a set point.
  EXPECT_EQ(write(0x6060, 0, Type::i8, 8), 0U);
  send(0x405, {0x0F, 0, 0, 0, 0, 0});
  node.sync(now);
  wait(101);
  EXPECT_EQ(node.error_code(), 0x8700);
}

TEST_F(OneNode, AZeroSwitchesTheSyncDeadlineOff) {
  EXPECT_EQ(write(0x2120, 1, Type::u16, 0), 0U);
  enable();
  for (int k = 0; k < 10; ++k) node.sync(now), wait(2);
  wait(5000);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
}

/// A mode's number, its RPDO with identifier and size, and a target that moves the drive.
struct SetPointRow {
  int mode, rpdo;
  std::uint32_t id;
  std::vector<std::uint8_t> bytes;
};
const SetPointRow set_points[] = {{8, 2, 0x405, {0x0F, 0, 0x10, 0, 0, 0}},
                                  {9, 3, 0x505, {0x0F, 0, 0x40, 0x42, 0x0F, 0}},
                                  {10, 4, 0x47F, {0x0F, 0, 0x90, 0x01}}};

/// Target positions of the interpolated position mode by RPDO3.
class Interpolated : public OneNode {
 protected:
  void SetUp() override {
    OneNode::SetUp();
    EXPECT_EQ(write(0x1402, 1, Type::u32, 0x80000405), 0U);
    EXPECT_EQ(write(0x1602, 0, Type::u8, 0), 0U);
    EXPECT_EQ(write(0x1602, 2, Type::u32, 0x60C10120), 0U);
    EXPECT_EQ(write(0x1602, 0, Type::u8, 2), 0U);
    EXPECT_EQ(write(0x1402, 1, Type::u32, 0x405), 0U);
    EXPECT_EQ(write(0x6060, 0, Type::i8, 7), 0U);
    enable();
  }
  void go(std::uint8_t word, double rad) {
    std::vector<std::uint8_t> data{word, 0, 0, 0, 0, 0};
    encode(std::llround(rad * 65536 * 100 / (2 * std::numbers::pi)), std::span(data).subspan(2));
    send(0x405, data);
    node.sync(now);
    wait(2);
  }
};

// Bit 4 switches the interpolation on and, along 6084h, off; bit 12 shows it.
TEST_F(Interpolated, FollowsItsTargetsWhileBit4IsSet) {
  EXPECT_EQ(write(0x6084, 0, Type::u32, 954930), 0U);  // 1 rad/s2 of the joint
  go(0x0F, 0.5);
  run(100);
  EXPECT_EQ(robot.position_rad, 0);
  EXPECT_EQ(status() & 0x1000, 0);
  for (int k = 1; k <= 100; ++k) {
    go(0x1F, 0.001 * k);
    EXPECT_EQ(status() & 0x1000, 0x1000);
    run(1);
    EXPECT_NEAR(robot.position_rad, 0.001 * (k - 0.5), 2e-6) << k;
    run(1);
    EXPECT_NEAR(robot.velocity_rad_s, 0.5, 1e-3);
  }
  go(0x0F, 1);
  EXPECT_EQ(status() & 0x1000, 0);
  run(250);
  EXPECT_NEAR(robot.velocity_rad_s, 0.25, 1e-3);
  run(260);
  EXPECT_EQ(robot.velocity_rad_s, 0);
  EXPECT_NEAR(robot.position_rad, 0.1 + 0.125, 1e-3);
  EXPECT_EQ(write(0x60C0, 0, Type::i16, -1), 0x06090030U);
  EXPECT_EQ(write(0x60C0, 0, Type::i16, 0), 0U);
}

// Set points are watched while it interpolates, and only then.
TEST_F(Interpolated, SetPointsAreWatched) {
  for (int k = 0; k < 10; ++k) go(0x0F, 0), run(2);
  for (int k = 0; k < 100; ++k) node.sync(now), wait(2), run(2);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  for (int k = 0; k < 10; ++k) go(0x1F, 0.001 * k), run(2);
  for (int k = 0; k < 20; ++k) node.sync(now), wait(2), run(2);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  node.sync(now);
  EXPECT_EQ(node.error_code(), 0x8250);
}

// 607Dh and 6080h hold as in CSP.
TEST_F(Interpolated, KeepsTheLimits) {
  for (int k = 0; k < 1000; ++k) {
    go(0x1F, 3);
    run(2);
    ASSERT_LE(robot.velocity_rad_s, 3.001);
  }
  EXPECT_NEAR(robot.position_rad, 2, 1e-4);
}

// While SYNCs go on, the absence of set points ends the operation after 20 of them (2121h), in every mode.
TEST_F(OneNode, StoppedSetPointsTakeThePower) {
  for (const auto& row : set_points) {
    SCOPED_TRACE(row.mode);
    nmt(0x81);
    EXPECT_EQ(write(static_cast<std::uint16_t>(0x1400 + row.rpdo), 1, Type::u32, 0x80000000 | row.id), 0U);
    EXPECT_EQ(write(static_cast<std::uint16_t>(0x1400 + row.rpdo), 1, Type::u32, row.id), 0U);
    EXPECT_EQ(write(0x6060, 0, Type::i8, row.mode), 0U);
    enable();
    for (int k = 0; k < 100; ++k) node.sync(now), wait(2), run(2);  // no set point yet: nothing is watched
    EXPECT_EQ(node.state(), DriveState::operation_enabled);
    for (int k = 0; k < 100; ++k) send(row.id, row.bytes), node.sync(now), wait(2), run(2);
    EXPECT_EQ(node.state(), DriveState::operation_enabled);
    bus.clear();
    for (int k = 0; k < 20; ++k) node.sync(now), wait(2), run(2);
    EXPECT_EQ(node.state(), DriveState::operation_enabled);
    node.sync(now);
    EXPECT_EQ(node.state(), DriveState::fault_reaction_active);
    EXPECT_EQ(text(on(0x085).at(0)).substr(0, 8), "085#5082");
    EXPECT_EQ(node.command(1e-3).torque_nm, 0);
    for (int k = 0; k < 300; ++k) node.sync(now), wait(2), run(2);
    EXPECT_EQ(node.state(), DriveState::fault);
    EXPECT_TRUE(node.brake_engaged());
  }
}

TEST_F(OneNode, TheSetPointDeadlineCountsInCyclesOfThePdo) {
  const auto stopped_after = [&] {  // set points; then SYNCs until the drive gives up
    enable();
    for (int k = 0; k < 3; ++k) send(0x405, {0x0F, 0, 0, 0, 0, 0}), node.sync(now), wait(2);
    for (int k = 1; k <= 1000; ++k) {
      node.sync(now);
      if (node.state() != DriveState::operation_enabled) return k;
      wait(2);
    }
    return -1;
  };
  EXPECT_EQ(write(0x2121, 1, Type::u16, 3), 0U);
  EXPECT_EQ(stopped_after(), 4);
  nmt(0x81);
  EXPECT_EQ(write(0x2121, 1, Type::u16, 3), 0U);
  EXPECT_EQ(write(0x1402, 2, Type::u8, 5), 0U);  // every fifth SYNC
  EXPECT_EQ(stopped_after(), 16);
  nmt(0x81);
  EXPECT_EQ(write(0x2121, 1, Type::u16, 0), 0U);
  EXPECT_EQ(stopped_after(), -1);
  nmt(0x81);
  EXPECT_EQ(write(0x1402, 5, Type::u16, 100), 0U);  // a deadline of its own is the one that counts
  EXPECT_EQ(stopped_after(), 51);
}

// Event-driven set points have no SYNC to be counted by: 20 cycles, at least 100 ms, by the clock.
TEST_F(OneNode, EventDrivenSetPointsAreWatchedByTheClock) {
  EXPECT_EQ(write(0x1402, 2, Type::u8, 255), 0U);
  enable();
  wait(1000);
  for (int k = 0; k < 10; ++k) send(0x405, {0x0F, 0, 0, 0, 0, 0}), wait(50);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  wait(50);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  wait(1);
  EXPECT_EQ(node.error_code(), 0x8250);
}

// Set points by SDO are nobody's cycle, nor are those of another mode.
TEST_F(OneNode, OnlySetPointsOfTheModeByPdoAreWatched) {
  enable();
  for (int k = 0; k < 10; ++k) send(0x405, {0x0F, 0, 0, 0, 0, 0}), node.sync(now), wait(2);
  EXPECT_EQ(write(0x6060, 0, Type::i8, 9), 0U);
  EXPECT_EQ(write(0x60FF, 0, Type::i32, 1000), 0U);
  for (int k = 0; k < 200; ++k) node.sync(now), wait(2);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
}

// A mode changed in motion: the drive keeps its speed or torque, and the master that gave it must stay.
TEST_F(OneNode, AMotionThatTheDriveKeepsIsWatched) {
  const auto stopped_after = [&](std::int64_t mode, bool set_points, bool given) {
    nmt(0x81);
    EXPECT_EQ(write(0x1403, 1, Type::u32, 0x505), 0U);
    EXPECT_EQ(write(0x6060, 0, Type::i8, 9), 0U);
    enable();
    const std::vector<std::uint8_t> set_point{0x0F, 0, 0x40, 0x0D, 0x03, 0};  // 200 rpm
    for (int k = 0; k < 100; ++k) send(0x505, set_point), node.sync(now), wait(2), run(2);
    robot.torque_nm = 5;
    node.feedback(robot, 1e-3);
    EXPECT_EQ(write(0x6060, 0, Type::i8, mode), 0U);
    if (given) EXPECT_EQ(write(0x6071, 0, Type::i16, 10), 0U);
    for (int k = 1; k <= 200; ++k) {
      if (set_points) send(0x505, set_point);
      node.sync(now);
      if (node.state() != DriveState::operation_enabled) return k;
      wait(2);
    }
    return -1;
  };
  EXPECT_EQ(stopped_after(10, false, false), 21);
  EXPECT_EQ(stopped_after(10, true, false), -1);  // the master is still there
  EXPECT_EQ(stopped_after(10, false, true), -1);  // a set point by SDO
  EXPECT_EQ(stopped_after(8, false, false), -1);  // CSP stands
}

TEST_F(OneNode, NmtTakesThePower) {
  for (const std::uint8_t command : {0x02, 0x80, 0x81, 0x82}) {
    nmt(0x82);
    enable();
    nmt(command);
    run(200);
    EXPECT_TRUE(node.brake_engaged()) << int(command);
    EXPECT_NE(node.state(), DriveState::operation_enabled) << int(command);
  }
}

TEST_F(OneNode, QuickStopRampsDown) {
  EXPECT_EQ(write(0x6085, 0, Type::u32, 95493), 0U);  // 10 rad/s2 at the motor, 0.1 at the joint
  EXPECT_EQ(write(0x6060, 0, Type::i8, 9), 0U);
  enable();
  EXPECT_EQ(write(0x60FF, 0, Type::i32, 95493), 0U);  // 10 rad/s at the motor
  run(10);
  EXPECT_NEAR(robot.velocity_rad_s, 0.1, 1e-4);
  control(0x02);
  run(500);
  EXPECT_NEAR(robot.velocity_rad_s, 0.05, 1e-3);
  EXPECT_EQ(node.state(), DriveState::quick_stop_active);
  run(600);
  EXPECT_EQ(node.state(), DriveState::switch_on_disabled);
}

// Bit 8 of the controlword: a ramp down (605Dh: 1 along 6084h, 2 along 6085h), then standstill, still enabled.
TEST_F(OneNode, HaltStopsEveryMode) {
  const double ramps_rad_s2[] = {0.1, 0.4};  // of the joint, by options 1 and 2
  for (const int mode : {1, 3, 6, 7, 8, 9, 10})
    for (const int option : {1, 2}) {
      SCOPED_TRACE(fmt::format("mode {}, option {}", mode, option));
      nmt(0x81);
      EXPECT_EQ(write(0x605D, 0, Type::i16, option), 0U);
      EXPECT_EQ(write(0x6084, 0, Type::u32, 95493), 0U);  // 10 rad/s2 at the motor
      EXPECT_EQ(write(0x6085, 0, Type::u32, 381972), 0U);
      EXPECT_EQ(write(0x6060, 0, Type::i8, mode), 0U);
      enable();
      robot = {.velocity_rad_s = 0.1};
      node.feedback(robot, 1e-3);
      control(0x10F);
      EXPECT_EQ(node.state(), DriveState::operation_enabled);
      EXPECT_EQ(status() & 0x0400, 0);  // does not stand
      if (mode != 3) EXPECT_EQ(status() & 0x1000, 0);
      EXPECT_EQ(write(0x60FF, 0, Type::i32, 300000), 0U);
      EXPECT_EQ(write(0x6071, 0, Type::i16, 400), 0U);
      send(0x405, {0x0F, 1, 0, 0, 0x10, 0});
      node.sync(now);
      const double half_s = 0.05 / ramps_rad_s2[option - 1];
      run(static_cast<int>(1000 * half_s));
      EXPECT_NEAR(robot.velocity_rad_s, 0.05, 1e-3);
      run(static_cast<int>(1000 * half_s) + 100);
      EXPECT_EQ(robot.velocity_rad_s, 0);
      EXPECT_EQ(node.state(), DriveState::operation_enabled);
      EXPECT_EQ(status() & 0x1400, mode == 3 ? 0x1400 : 0x0400);  // target reached: it stands
      EXPECT_EQ(node.command(1e-3).mode, twin::DriveCommand::Mode::velocity);
      control(0x0F);
      EXPECT_EQ(status() & 0x1400, mode == 1 || mode == 7 ? 0 : mode == 6 ? 0x0400 : 0x1000);
      const auto c = node.command(1e-3);
      if (mode < 9 && mode != 3) EXPECT_NEAR(c.position_rad, robot.position_rad, 1e-9);  // until the next target
      if (mode == 3) EXPECT_GT(c.velocity_rad_s, 0);
      if (mode == 9) EXPECT_NEAR(c.velocity_rad_s, 0.1 * std::numbers::pi, 1e-6);
      if (mode == 10) EXPECT_NEAR(c.torque_nm, 80, 1e-9);
    }
  EXPECT_EQ(write(0x605D, 0, Type::i16, 3), 0x06090031U);
  EXPECT_EQ(write(0x605D, 0, Type::i16, 0), 0x06090032U);
}

// A halted drive asks for no set points, but goes on asking when it is released.
TEST_F(OneNode, HaltPausesTheSetPointDeadline) {
  enable();
  for (int k = 0; k < 3; ++k) send(0x405, {0x0F, 0, 0, 0, 0, 0}), node.sync(now), wait(2), run(2);
  control(0x10F);
  for (int k = 0; k < 100; ++k) node.sync(now), wait(2), run(2);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  control(0x0F);
  for (int k = 0; k < 21; ++k) node.sync(now), wait(2), run(2);
  EXPECT_EQ(node.error_code(), 0x8250);
}

TEST_F(OneNode, TransmissionTypes) {
  // TPDO1 every third SYNC, TPDO2 on SYNC when changed.
  EXPECT_EQ(write(0x1800, 2, Type::u8, 3), 0U);
  EXPECT_EQ(write(0x1801, 2, Type::u8, 0), 0U);
  EXPECT_EQ(write(0x1802, 2, Type::u8, 241), 0x06090030U);
  nmt(1);
  bus.clear();
  for (int i = 0; i < 9; ++i) node.sync(now);
  EXPECT_EQ(on(0x185).size(), 3U);
  EXPECT_EQ(on(0x285).size(), 1U);
  EXPECT_EQ(on(0x385).size(), 9U);
  control(0x06);
  node.sync(now);
  EXPECT_EQ(on(0x285).size(), 2U);
}

TEST_F(OneNode, EventTimerAndInhibitTime) {
  EXPECT_EQ(write(0x1800, 5, Type::u16, 20), 0U);
  EXPECT_EQ(write(0x1800, 3, Type::u16, 50), 0x08000022U);  // not while the PDO exists
  EXPECT_EQ(write(0x1800, 3, Type::u16, 0), 0U);            // unchanged
  EXPECT_EQ(write(0x1800, 1, Type::u32, 0xC0000185), 0U);
  EXPECT_EQ(write(0x1800, 3, Type::u16, 50), 0U);  // 5 ms
  EXPECT_EQ(write(0x1800, 1, Type::u32, 0x40000185), 0U);
  nmt(1);
  wait(1);
  bus.clear();
  wait(100);
  EXPECT_EQ(on(0x185).size(), 5U);
  bus.clear();
  control(0x06);
  wait(1);
  control(0x00);
  wait(1);
  control(0x06);
  wait(1);
  EXPECT_LE(on(0x185).size(), 1U);
  EXPECT_GT(node.next_ns(), now);  // nothing to do before the inhibit time is over
  wait(6);
  ASSERT_FALSE(on(0x185).empty());
  EXPECT_EQ(on(0x185).back().data[0] & 0x6F, 0x21);  // the last state got through
}

TEST_F(OneNode, ShortPdosAreRefusedAndLongOnesTaken) {
  enable();
  send(0x405, {0x0F, 0, 0});
  EXPECT_EQ(text(on(0x085).at(0)).substr(0, 8), "085#1082");
  EXPECT_EQ(node.counters().pdo_short, 1U);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  send(0x205, {0x07, 0, 1, 2, 3});
  EXPECT_FALSE((status() & 0x1000) != 0);
}

TEST_F(OneNode, PdosOnlyCountWhenOperational) {
  control(0x06);
  EXPECT_EQ(node.state(), DriveState::switch_on_disabled);
  nmt(1);
  control(0x06);
  EXPECT_EQ(node.state(), DriveState::ready_to_switch_on);
}

TEST_F(OneNode, SdoInSegments) {
  bus.clear();
  EXPECT_EQ(sdo({0x40, 0x08, 0x10, 0}), 0U);
  EXPECT_EQ(on(0x585).at(0).data[0], 0x41);
  std::string name;
  for (std::uint8_t toggle = 0, last = 0; !last; toggle ^= 0x10) {
    ASSERT_EQ(sdo({static_cast<std::uint8_t>(0x60 | toggle)}), 0U);
    const auto d = on(0x585).at(0).data;
    name.append(d.begin() + 1, d.begin() + 8 - (d[0] >> 1 & 7));
    last = d[0] & 1;
  }
  EXPECT_EQ(name, "tribotwin drive joint5");
  // A download in segments of what is also expedited.
  EXPECT_EQ(sdo({0x21, 0x85, 0x60, 0, 4}), 0U);
  EXPECT_EQ(sdo({0x07, 0x10, 0x27, 0, 0}), 0U);  // 4 bytes, last
  EXPECT_EQ(node.dictionary().get(0x6085), 10000);
  // Toggle, time-out, unknown commands, abort by the client.
  EXPECT_EQ(sdo({0x40, 0x08, 0x10, 0}), 0U);
  EXPECT_EQ(sdo({0x70}), 0x05030000U);
  EXPECT_EQ(sdo({0x60}), 0x05040001U);
  EXPECT_EQ(sdo({0xE0, 0x08, 0x10, 0}), 0x05040001U);
  EXPECT_EQ(sdo({0x40, 0x08, 0x10, 0}), 0U);
  bus.clear();
  wait(1001);
  ASSERT_EQ(on(0x585).size(), 1U);
  EXPECT_EQ(decode(Type::u32, std::span(on(0x585)[0].data).subspan(4, 4)), 0x05040000);
  EXPECT_EQ(sdo({0x21, 0x85, 0x60, 0, 0, 0, 1}), 0x06070012U);
  EXPECT_EQ(write(0x6007, 0, Type::i16, 0), 0x06090032U);
  EXPECT_EQ(write(0x605A, 0, Type::i16, 4), 0x06090030U);
  EXPECT_EQ(write(0x1000, 0, Type::u32, 4), 0x06010002U);
}

// 1021h: the EDS of this drive, in blocks.
TEST_F(OneNode, HandsOutItsEds) {
  const std::string expected = eds(node.dictionary(), parameters);
  send(0x605, {0xA4, 0x21, 0x10, 0, 127, 0, 0, 0});
  ASSERT_EQ(on(0x585).size(), 1U);
  EXPECT_EQ(decode(Type::u32, on(0x585)[0].bytes().subspan(4)), static_cast<std::int64_t>(expected.size()));
  send(0x605, {0xA3, 0, 0, 0, 0, 0, 0, 0});
  std::string text;
  for (std::uint8_t end = 0; end == 0;) {
    const auto block = on(0x585);
    bus.clear();
    for (const Frame& f : block)
      if (f.data[0] != 0xC6) text.append(f.data.begin() + 1, f.data.begin() + 8);
    send(0x605, {0xA2, static_cast<std::uint8_t>(block.back().data[0] & 0x7F), 127, 0, 0, 0, 0, 0});
    ASSERT_FALSE(bus.empty());
    end = block.back().data[0] & 0x80;
    if (end) text.resize(text.size() - (bus.back().data[0] >> 2 & 7));
  }
  EXPECT_EQ(text, expected);
}

TEST_F(OneNode, StoppedHasNoSdo) {
  EXPECT_EQ(sdo({0xC4, 0x80, 0x21, 0}), 0U);  // a block download
  nmt(2);
  bus.clear();
  wait(3000);
  EXPECT_TRUE(on(0x585).empty());
}

// CiA 301, table of restricted identifiers; and 080h and 085h, which are this drive's SYNC and EMCY.
TEST_F(OneNode, IdentifiersOfPdos) {
  const auto restricted = [](std::uint32_t id) {
    return id <= 0x07F || (id >= 0x101 && id <= 0x180) || (id >= 0x581 && id <= 0x5FF) ||
           (id >= 0x601 && id <= 0x67F) || (id >= 0x6E0 && id <= 0x6FF) || id >= 0x701;
  };
  for (std::uint32_t id = 0; id <= 0x7FF; ++id)
    for (const int pdo : {0x1402, 0x1802}) {
      const auto index = static_cast<std::uint16_t>(pdo);
      EXPECT_EQ(write(index, 1, Type::u32, 0x80000000 | id), 0U);
      const std::uint32_t expected = restricted(id) ? 0x06090030U : id == 0x080 || id == 0x085 ? 0x06040043U : 0U;
      EXPECT_EQ(write(index, 1, Type::u32, id), expected) << text(classic(id, {}));
    }
  // A PDO beside the SDOs.
  for (const auto& [index, id] : {std::pair<std::uint16_t, std::uint32_t>{0x1402, 0x680}, {0x1802, 0x580}}) {
    EXPECT_EQ(write(index, 1, Type::u32, 0x80000000), 0U);
    EXPECT_EQ(write(index, 1, Type::u32, id), 0U);
  }
  nmt(1);
  bus.clear();
  send(0x680, {0x06, 0, 0, 0, 0, 0});
  node.sync(now);
  EXPECT_EQ(node.state(), DriveState::ready_to_switch_on);
  EXPECT_EQ(on(0x580).size(), 1U);
}

TEST_F(OneNode, RemappingNeedsAPdoThatDoesNotExist) {
  EXPECT_EQ(write(0x1A02, 0, Type::u8, 0), 0x08000022U);  // pre-operational, too
  EXPECT_EQ(write(0x1A02, 0, Type::u8, 2), 0U);           // unchanged
  nmt(1);
  EXPECT_EQ(write(0x1A02, 0, Type::u8, 0), 0x08000022U);
  EXPECT_EQ(write(0x1802, 1, Type::u32, 0x80000385), 0U);
  EXPECT_EQ(write(0x1A02, 1, Type::u32, 0x60410010), 0x08000022U);  // number of objects first
  EXPECT_EQ(write(0x1A02, 0, Type::u8, 0), 0U);
  EXPECT_EQ(write(0x1A02, 1, Type::u32, 0x21000110), 0U);
  EXPECT_EQ(write(0x1A02, 2, Type::u32, 0x21010120), 0U);
  EXPECT_EQ(write(0x1A02, 3, Type::u32, 0x60400010), 0U);
  EXPECT_EQ(write(0x1A02, 4, Type::u32, 0x99990010), 0x06020000U);
  EXPECT_EQ(write(0x1A02, 0, Type::u8, 3), 0U);
  EXPECT_EQ(write(0x1802, 1, Type::u32, 0x00000701), 0x06090030U);  // a heartbeat's
  EXPECT_EQ(write(0x1802, 1, Type::u32, 0x00000385), 0U);
  robot.temperature_degC = 61.5;
  robot.friction_nm = -3.25;
  node.feedback(robot, 0);
  bus.clear();
  node.sync(now);
  const auto sent = on(0x385);
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_EQ(sent[0].size, 8);
  EXPECT_EQ(decode(Type::i16, std::span(sent[0].data).subspan(0, 2)), 615);
  EXPECT_EQ(decode(Type::i32, std::span(sent[0].data).subspan(2, 4)), -3250);
}

TEST_F(OneNode, AGapInAnRpdoIsSkipped) {
  EXPECT_EQ(write(0x1402, 1, Type::u32, 0x80000405), 0U);
  EXPECT_EQ(write(0x1602, 0, Type::u8, 0), 0U);
  EXPECT_EQ(write(0x1602, 1, Type::u32, 0x00070020), 0U);
  EXPECT_EQ(write(0x1602, 2, Type::u32, 0x60400010), 0U);
  EXPECT_EQ(write(0x1602, 0, Type::u8, 2), 0U);
  EXPECT_EQ(write(0x1402, 1, Type::u32, 0x00000405), 0U);
  nmt(1);
  send(0x405, {1, 2, 3, 4, 0x06, 0});
  node.sync(now);
  EXPECT_EQ(node.state(), DriveState::ready_to_switch_on);
}

TEST_F(OneNode, AGapHasTheBitsOfItsType) {
  EXPECT_EQ(write(0x1402, 1, Type::u32, 0x80000405), 0U);
  EXPECT_EQ(write(0x1602, 0, Type::u8, 0), 0U);
  for (const std::uint32_t good : {0x00020008U, 0x00030010U, 0x00040020U, 0x00050008U, 0x00060010U, 0x00070020U})
    EXPECT_EQ(write(0x1602, 1, Type::u32, good), 0U) << good;
  for (const std::uint32_t bad : {0x00010001U, 0x00010008U, 0x00020010U, 0x00070008U})
    EXPECT_NE(write(0x1602, 1, Type::u32, bad), 0U) << bad;
}

TEST_F(OneNode, IdentifiersOf29BitsAreRefused) {
  EXPECT_EQ(write(0x1402, 1, Type::u32, 0x80000405), 0U);
  EXPECT_EQ(write(0x1402, 1, Type::u32, 0x20000405), 0x06090030U);
}

// Communication objects by 82h, all of them by 81h; the history with both.
TEST_F(OneNode, WhatAResetResets) {
  enable();
  node.fail(0x1000, 1, false, now);
  EXPECT_EQ(write(0x6065, 0, Type::u32, 777), 0U);
  EXPECT_EQ(write(0x1017, 0, Type::u16, 33), 0U);
  nmt(0x82);
  EXPECT_EQ(node.dictionary().get(0x6065), 777);
  EXPECT_EQ(node.dictionary().get(0x1017), 500);
  EXPECT_EQ(node.dictionary().get(0x1003, 1), 0);
  nmt(0x81);
  EXPECT_NE(node.dictionary().get(0x6065), 777);
}

TEST_F(OneNode, AnErrorOfTheMomentIsGoneAfterIt) {
  enable();
  send(0x405, {0x0F, 0, 0});
  ASSERT_EQ(on(0x085).size(), 2U);
  EXPECT_EQ(text(on(0x085)[1]), "085#0000000000000000");
  EXPECT_EQ(node.dictionary().get(0x1001), 0);
  EXPECT_EQ(node.dictionary().get(0x1003, 1), 0x8210);
}

TEST_F(OneNode, EmergencyHistory) {
  enable();
  for (const std::uint16_t code : {0x1000, 0x4310}) {
    node.fail(code, 1, false, now);
    control(0x00);
    control(0x80);
    control(0x00);
  }
  EXPECT_EQ(node.dictionary().get(0x1003, 0), 2);
  EXPECT_EQ(node.dictionary().get(0x1003, 1), 0x4310);
  EXPECT_EQ(node.dictionary().get(0x1003, 2), 0x1000);
  EXPECT_EQ(write(0x1003, 0, Type::u8, 1), 0x06090030U);
  EXPECT_EQ(write(0x1003, 0, Type::u8, 0), 0U);
  EXPECT_EQ(node.dictionary().get(0x1003, 1), 0);
}

// CiA 301, 7.5.2.4: without an error there is no data.
TEST_F(OneNode, AnEmptyHistoryHasNoData) {
  EXPECT_EQ(sdo({0x40, 0x03, 0x10, 0}), 0U);
  EXPECT_EQ(sdo({0x40, 0x03, 0x10, 1}), 0x08000024U);
  EXPECT_EQ(sdo({0x40, 0x03, 0x10, 9}), 0x06090011U);
  node.fail(0x1000, 1, false, now);
  EXPECT_EQ(sdo({0x40, 0x03, 0x10, 1}), 0U);
  EXPECT_EQ(sdo({0x40, 0x03, 0x10, 2}), 0x08000024U);
  EXPECT_EQ(write(0x1003, 0, Type::u8, 0), 0U);
  EXPECT_EQ(sdo({0x40, 0x03, 0x10, 1}), 0x08000024U);
}

TEST_F(OneNode, ANodeIsWatchedOnce) {
  EXPECT_EQ(write(0x1016, 1, Type::u32, 0x7F << 16 | 50), 0U);
  EXPECT_EQ(write(0x1016, 2, Type::u32, 0x7F << 16 | 100), 0x06040043U);
  EXPECT_EQ(write(0x1016, 2, Type::u32, 0x7F << 16), 0U);  // no time: not watched
  EXPECT_EQ(write(0x1016, 2, Type::u32, 0x7E << 16 | 50), 0U);
  EXPECT_EQ(write(0x1016, 1, Type::u32, 0x7F << 16 | 70), 0U);  // itself, with another time
  EXPECT_EQ(write(0x1016, 1, Type::u32, 0x7E << 16 | 70), 0x06040043U);
}

TEST_F(OneNode, HeatIsWarnedOfAndThenAFault) {
  enable();
  robot.temperature_degC = 115;
  run(1);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  node.feedback(robot, 1e-3);
  EXPECT_TRUE(status() & 0x80);
  robot.temperature_degC = 121;
  node.feedback(robot, 1e-3);
  EXPECT_EQ(node.error_code(), 0x4310);
}

TEST_F(OneNode, WithoutAWindingNoObjectSpeaksOfOne) {
  EXPECT_EQ(node.dictionary().find(0x2100, 2), nullptr);
  EXPECT_EQ(node.dictionary().find(0x2111, 2), nullptr);
  EXPECT_EQ(node.dictionary().get(0x2100, 0), 1);
  EXPECT_EQ(node.dictionary().get(0x2111, 0), 1);
}

TEST(Winding, ItsHeatIsAnObjectAWarningAndAFault) {
  DriveParameters p = parameters;
  p.winding = {25, 130, 155};
  std::vector<Frame> bus;
  Node node(p, [&](const Frame& frame) {
    bus.push_back(frame);
    return Sent::done;
  });
  EXPECT_EQ(node.dictionary().get(0x2100, 0), 2);
  EXPECT_EQ(node.dictionary().get(0x2100, 2), 250);
  EXPECT_EQ(node.dictionary().get(0x2111, 2), 1550);
  EXPECT_EQ(node.dictionary().get(0x2111, 3), 1300);
  const auto warned = [&] { return (node.dictionary().get(od::statusword) & 0x80) != 0; };
  Feedback robot;
  robot.winding_degC = 129.9;
  node.feedback(robot, 1e-3);
  EXPECT_EQ(node.dictionary().get(0x2100, 2), 1299);
  EXPECT_FALSE(warned());
  robot.winding_degC = 131;
  node.feedback(robot, 1e-3);
  EXPECT_TRUE(warned());
  EXPECT_EQ(node.error_code(), 0);
  robot.winding_degC = 155.1;
  node.feedback(robot, 1e-3);
  EXPECT_EQ(node.error_code(), 0x4310);
  EXPECT_EQ(node.dictionary().get(0x2100, 1), 250);  // the lubricant is cool
}

TEST_F(OneNode, AnotherNodeWithItsNumberIsCounted) {
  send(0x705, {5});
  send(0x585, {0x60, 0, 0, 0, 0, 0, 0, 0});
  EXPECT_EQ(node.counters().foreign, 2U);
}

TEST_F(OneNode, AFullBusStopsNothing) {
  enable();
  full = true;
  for (int i = 0; i < 100; ++i) node.sync(now), wait(1), run(1);
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  full = false;
  const auto sent = node.counters().pdo_sent;
  node.sync(now);
  EXPECT_GT(node.counters().pdo_sent, sent);
}

// Anything on the bus, in any order, at any time: no crash, and never power without the state for it.
TEST_F(OneNode, RandomAndMutatedFrames) {
  std::mt19937 random(11);
  const std::vector<std::uint32_t> ids = {0, 0x80, 0x205, 0x305, 0x405, 0x505, 0x605, 0x705, 0x77F, 0x585};
  const std::vector<std::vector<std::uint8_t>> seeds = {{1, 5},
                                                        {0x06, 0},
                                                        {0x07, 0},
                                                        {0x0F, 0},
                                                        {0x0F, 0, 0x10, 0, 0, 0},
                                                        {0x40, 0x08, 0x10, 0, 0, 0, 0, 0},
                                                        {0x60, 0, 0, 0, 0, 0, 0, 0},
                                                        {0x23, 0x02, 0x14, 1, 5, 4, 0, 0x80},
                                                        {0x2F, 0x02, 0x1A, 0, 0, 0, 0, 0},
                                                        {0x23, 0x02, 0x1A, 1, 0x20, 0, 0x64, 0x60},
                                                        {0x80, 5},
                                                        {0x81, 0}};
  bus.reserve(4096);
  for (int i = 0; i < 1'000'000; ++i) {
    Frame f;
    f.id = random() % 8 ? ids[random() % ids.size()] : random() & 0x7ff;
    auto bytes = seeds[random() % seeds.size()];
    if (random() % 2) bytes.resize(random() % 9);
    for (auto& b : bytes)
      if (random() % 6 == 0) b = static_cast<std::uint8_t>(random());
    f.size = static_cast<std::uint8_t>(bytes.size());
    std::ranges::copy(bytes, f.data.begin());
    f.extended = random() % 64 == 0;
    f.remote = random() % 64 == 0;
    now += static_cast<std::int64_t>(random() % 3) * ms;
    if (f.id == 0x80 && f.size <= 1)
      node.sync(now);
    else
      node.receive(f, now);
    node.tick(now);
    run(1);
    const auto c = node.command(1e-3);
    if (node.brake_engaged()) ASSERT_EQ(c.mode, twin::DriveCommand::Mode::off);
    ASSERT_TRUE(std::isfinite(c.position_rad + c.velocity_rad_s + c.torque_nm));
    ASSERT_LE(node.next_ns() - now, 70'000 * ms);
    for (const Frame& sent : bus) ASSERT_LE(sent.size, 8);
    bus.clear();
  }
}

TEST(Description, EdsListsEveryObjectOnce) {
  const Dictionary dictionary = drive_dictionary(parameters);
  const std::string s = eds(dictionary, parameters);
  for (const Object& o : dictionary.objects()) {
    const bool single = !dictionary.find(o.index, 1);
    const std::string section =
        single ? fmt::format("[{:04X}]\n", o.index) : fmt::format("[{:04X}sub{:X}]\n", o.index, o.sub);
    const auto at = s.find(section);
    ASSERT_NE(at, std::string::npos) << section;
    EXPECT_EQ(s.find(section, at + 1), std::string::npos) << section;
  }
}

TEST(Description, EdsHasTheLimitsOfTheModes) {
  const std::string s = eds(drive_dictionary(parameters), parameters);
  const auto section = s.substr(s.find("[6060]"), s.find("[6061]") - s.find("[6060]"));
  EXPECT_THAT(section, testing::HasSubstr("LowLimit=0\nHighLimit=10\n"));
}

// can-facts.md: SYNC + 6 x 8 B + 6 x 8 B at 1 kHz: 1379 to 1675 bits.
TEST(Budget, TableOfTheFacts) {
  Frame eight;
  eight.size = 8;
  EXPECT_EQ(classic_bits(0).min + 12 * classic_bits(8).min, 1379);
  EXPECT_EQ(classic_bits(0).max + 12 * classic_bits(8).max, 1675);
  std::vector<DriveParameters> p(6, parameters);
  std::vector<Dictionary> d;
  std::vector<DescribedDrive> drives;
  for (int i = 0; i < 6; ++i)
    p[static_cast<std::size_t>(i)].node = static_cast<std::uint8_t>(i + 1),
    d.push_back(drive_dictionary(p[static_cast<std::size_t>(i)]));
  for (std::size_t i = 0; i < 6; ++i) drives.push_back({&d[i], &p[i]});
  const Budget b = budget(drives, 0.002, 1e6);
  EXPECT_EQ(b.frames, 13);  // one PDO each way
  EXPECT_LT(b.max, 0.8);
  EXPECT_GT(budget(drives, 0.001, 1e6).max, 1);
}

}  // namespace
}  // namespace tribotwin::hil
