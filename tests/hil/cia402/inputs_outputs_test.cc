// Safe torque off, the brake as an output, and touch probes.
#include <cmath>
#include <numbers>

#include <tribotwin/tests/hil/cia402/one_node.hpp>

namespace tribotwin::hil {
namespace {

constexpr double turn = 2 * std::numbers::pi / 100, per_rad = 65536 / turn;

class InputsAndOutputs : public OneNode {
 protected:
  void safe_torque_off(bool on) {
    robot.safe_torque_off = on;
    node.feedback(robot, 1e-3);
  }
  std::int64_t inputs() { return node.dictionary().get(0x60FD); }
  void move_to(double joint_rad) {
    robot.position_rad = joint_rad;
    node.feedback(robot, 1e-3);
  }
};

// With power a fault at once, without a ramp; without power back to switch on disabled; no way out of it.
TEST_F(InputsAndOutputs, SafeTorqueOff) {
  enable();
  EXPECT_EQ(status() & 0x10, 0x10);
  safe_torque_off(true);
  EXPECT_EQ(node.state(), DriveState::fault);
  EXPECT_EQ(text(on(0x085).at(0)).substr(0, 10), "085#009001");
  EXPECT_EQ(node.command(1e-3).mode, twin::DriveCommand::Mode::off);
  EXPECT_TRUE(node.brake_engaged());
  EXPECT_EQ(status() & 0x10, 0);
  EXPECT_EQ(inputs(), 8);
  control(0x80);
  EXPECT_EQ(node.state(), DriveState::switch_on_disabled);
  for (const std::uint16_t word : {0x06, 0x07, 0x0F}) control(word);
  EXPECT_EQ(node.state(), DriveState::switch_on_disabled);
  safe_torque_off(false);
  EXPECT_EQ(node.state(), DriveState::switch_on_disabled);
  EXPECT_EQ(status() & 0x10, 0x10);
  EXPECT_EQ(inputs(), 0);
  for (const std::uint16_t word : {0x06, 0x07}) control(word);
  EXPECT_EQ(node.state(), DriveState::switched_on);
  safe_torque_off(true);
  EXPECT_EQ(node.state(), DriveState::switch_on_disabled);
  EXPECT_EQ(node.error_code(), 0);
}

// No state keeps power: quick stop and the ramp of a fault are cut short.
TEST_F(InputsAndOutputs, SafeTorqueOffEndsRamps) {
  for (const bool fault : {false, true}) {
    nmt(0x81);
    robot = {.velocity_rad_s = 0.5};
    node.feedback(robot, 0);
    enable();
    if (fault)
      node.fail(0x1000, 1, true, now);
    else
      control(0x02);
    EXPECT_FALSE(node.brake_engaged());
    safe_torque_off(true);
    EXPECT_EQ(node.state(), DriveState::fault);
    EXPECT_TRUE(node.brake_engaged());
    safe_torque_off(false);
    control(0x80);
    control(0x00);
  }
}

// The master may set the brake of an enabled drive, never release the one of a drive without power.
TEST_F(InputsAndOutputs, TheBrakeIsAnOutput) {
  EXPECT_EQ(write(0x60FE, 1, Type::u32, 1), 0U);
  enable();
  EXPECT_FALSE(node.brake_engaged());  // not in the mask
  EXPECT_EQ(write(0x60FE, 2, Type::u32, 1), 0U);
  EXPECT_TRUE(node.brake_engaged());
  EXPECT_EQ(node.state(), DriveState::operation_enabled);
  node.feedback(robot, 1e-3);
  EXPECT_EQ(inputs() & 0x20000, 0);
  EXPECT_EQ(write(0x60FE, 1, Type::u32, 0), 0U);
  EXPECT_FALSE(node.brake_engaged());
  node.feedback(robot, 1e-3);
  EXPECT_EQ(inputs() & 0x20000, 0x20000);
  control(0x00);
  EXPECT_TRUE(node.brake_engaged());
}

// 60B8h of probe 1; positions that the joint goes to; 60B9h, 60BAh and 60BBh then. The home switch is at 0.5 rad.
TEST_F(InputsAndOutputs, TouchProbes) {
  const double pulse = std::ceil(0.5 / turn) * turn;
  struct Row {
    std::int64_t function;
    std::vector<double> way_rad;
    std::int64_t status;
    double rising_rad, falling_rad;
  } rows[] = {{0x10, {0.4, 0.6, 0.4}, 0, 0, 0},  // not switched on
              {0x01, {0.4, 0.6, 0.4}, 1, 0, 0},  // no edge asked for
              {0x11, {0.4, 0.6, 0.4}, 3, 0.5, 0},
              {0x21, {0.4, 0.6, 0.4}, 5, 0, 0.5},
              {0x31, {0.4, 0.6, 0.4}, 7, 0.5, 0.5},
              {0x15, {0.501, pulse + 0.01, pulse + turn + 0.01}, 3, pulse, 0},          // the first index pulse
              {0x17, {0.501, pulse + 0.01, pulse + turn + 0.01}, 3, pulse + turn, 0}};  // each, so the last
  for (const auto& row : rows)
    for (const int probe : {0, 1}) {
      SCOPED_TRACE(row.function);
      nmt(0x81);
      EXPECT_EQ(write(0x2130, static_cast<std::uint8_t>(1 + probe), Type::i32, std::llround(0.5 * per_rad)), 0U);
      move_to(row.way_rad[0]);
      EXPECT_EQ(write(0x60B8, 0, Type::u16, 0), 0U);
      EXPECT_EQ(write(0x60B8, 0, Type::u16, row.function << 8 * probe), 0U);
      const auto old_rising = node.dictionary().get(probe ? 0x60BC : 0x60BA);
      for (const double at : row.way_rad) move_to(at);
      EXPECT_EQ(node.dictionary().get(0x60B9), row.status << 8 * probe);
      const auto caught = [&](int index) { return node.dictionary().get(static_cast<std::uint16_t>(index)); };
      if (row.status & 2)
        EXPECT_EQ(caught(probe ? 0x60BC : 0x60BA), std::llround(row.rising_rad * per_rad));
      else
        EXPECT_EQ(caught(probe ? 0x60BC : 0x60BA), old_rising);
      if (row.status & 4) EXPECT_EQ(caught(probe ? 0x60BD : 0x60BB), std::llround(row.falling_rad * per_rad));
    }
  for (const int bad : {0x09, 0x0D, 0x0801}) EXPECT_EQ(write(0x60B8, 0, Type::u16, bad), 0x06090030U);
}

// The first event only, until the probe is switched off and on; switching an edge off forgets it.
TEST_F(InputsAndOutputs, ATouchProbeIsArmedAgain) {
  EXPECT_EQ(write(0x2130, 1, Type::i32, std::llround(0.5 * per_rad)), 0U);
  EXPECT_EQ(write(0x60B8, 0, Type::u16, 0x11), 0U);
  for (const double at : {0.4, 0.6}) move_to(at);
  EXPECT_EQ(node.dictionary().get(0x60B9), 3);
  EXPECT_EQ(write(0x60B8, 0, Type::u16, 0x01), 0U);
  EXPECT_EQ(node.dictionary().get(0x60B9), 1);
  EXPECT_EQ(write(0x60B8, 0, Type::u16, 0x11), 0U);
  EXPECT_EQ(node.dictionary().get(0x60B9), 1);
  EXPECT_EQ(write(0x2130, 1, Type::i32, std::llround(0.55 * per_rad)), 0U);
  for (const double at : {0.4, 0.6}) move_to(at);
  EXPECT_EQ(node.dictionary().get(0x60B9), 3);
  EXPECT_EQ(node.dictionary().get(0x60BA), std::llround(0.55 * per_rad));
  EXPECT_EQ(write(0x60B8, 0, Type::u16, 0), 0U);
  EXPECT_EQ(node.dictionary().get(0x60B9), 0);
  EXPECT_EQ(node.dictionary().get(0x60BA), std::llround(0.55 * per_rad));  // the position stays
}

}  // namespace
}  // namespace tribotwin::hil
