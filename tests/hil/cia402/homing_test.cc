// Homing: where each method finds home, what the positions are then, and the bits on the way. Joint range -2 .. 2 rad,
// one turn of the motor is 2 pi / 100 rad.
#include <cmath>
#include <numbers>

#include <tribotwin/hil/motion/inputs.hpp>
#include <tribotwin/tests/hil/cia402/one_node.hpp>

namespace tribotwin::hil {
namespace {

constexpr double turn = 2 * std::numbers::pi / 100, per_rad = 65536 / turn, degree = std::numbers::pi / 180;
enum Bits : std::uint16_t { reached = 0x0400, attained = 0x1000, error = 0x2000, all = 0x3400 };

class Homing : public OneNode {
 protected:
  void SetUp() override {
    OneNode::SetUp();
    EXPECT_EQ(write(0x6060, 0, Type::i8, 6), 0U);
  }
  void begin(double joint_rad, int method) {
    robot = {.position_rad = joint_rad};
    node.feedback(robot, 0);
    EXPECT_EQ(write(0x6098, 0, Type::i8, method), 0U);
    enable();
    run(1);
    EXPECT_EQ(status() & all, reached);  // nothing yet
    control(0x1F);
  }
  /// Steps until the statusword's bits are `bits`.
  bool until(std::uint16_t bits, int steps = 60'000) {
    while ((status() & all) != bits && steps-- > 0) run(1);
    return (status() & all) == bits;
  }
  double position() { return static_cast<double>(node.dictionary().get(0x6064)) / per_rad; }
};

TEST_F(Homing, EveryMethodFindsItsHome) {
  const double low = -2 + degree, high = 2 - degree;
  const auto next = [](double rad) { return (std::floor(rad / turn) + 1) * turn; };
  const auto last = [](double rad) { return std::floor(rad / turn) * turn; };
  struct Row {
    int method;
    double start, home;
  } rows[] = {{1, -1.5, next(low)}, {1, -1.999, next(low)}, {2, 1.5, last(high)}, {17, -1.5, low},
              {17, -1.995, low},    {18, 1.5, high},        {33, 0.7, last(0.7)}, {33, -0.7, last(-0.7)},
              {34, 0.7, next(0.7)}, {35, 0.3, 0.3},         {37, -0.3, -0.3}};
  for (const double offset : {0.0, 0.25})
    for (const auto& row : rows) {
      SCOPED_TRACE(row.method);
      nmt(0x81);
      EXPECT_EQ(write(0x6060, 0, Type::i8, 6), 0U);
      EXPECT_EQ(write(0x607C, 0, Type::i32, std::llround(offset * per_rad)), 0U);
      begin(row.start, row.method);
      if (row.method < 35) EXPECT_TRUE(until(0));  // on its way
      EXPECT_TRUE(until(attained | reached));
      EXPECT_EQ(robot.velocity_rad_s, 0);
      EXPECT_NEAR(position(), robot.position_rad - row.home - offset, 1e-6);
      EXPECT_NEAR(static_cast<double>(node.dictionary().get(0x6062)) / per_rad, position(), 2 / per_rad);
      const double here = robot.position_rad;
      control(0x0F);
      run(100);
      EXPECT_EQ(robot.position_rad, here);  // the new zero moves nothing
      EXPECT_EQ(status() & all, attained | reached);
    }
}

// Fast to the switch, slowly off it, with 609Ah in between, and never beyond 6080h.
TEST_F(Homing, SpeedsAndAccelerations) {
  const double per_rad_s = 60e3 / turn;
  EXPECT_EQ(write(0x6099, 1, Type::u32, std::llround(0.2 * per_rad_s)), 0U);
  EXPECT_EQ(write(0x6099, 2, Type::u32, std::llround(0.05 * per_rad_s)), 0U);
  EXPECT_EQ(write(0x609A, 0, Type::u32, std::llround(2 * per_rad_s)), 0U);
  begin(-1.8, 17);
  double fastest_down = 0, fastest_up = 0, hardest = 0, before = 0;
  while ((status() & all) != (attained | reached)) {
    run(1);
    fastest_down = std::min(fastest_down, robot.velocity_rad_s);
    fastest_up = std::max(fastest_up, robot.velocity_rad_s);
    hardest = std::max(hardest, std::abs(robot.velocity_rad_s - before));
    before = robot.velocity_rad_s;
  }
  EXPECT_NEAR(fastest_down, -0.2, 1e-6);
  EXPECT_NEAR(fastest_up, 0.05, 1e-6);
  EXPECT_NEAR(hardest, 2e-3, 1e-8);
  EXPECT_EQ(write(0x6080, 0, Type::u32, 10), 0U);
  control(0x0F);
  control(0x1F);
  fastest_down = 0;
  for (int k = 0; k < 1000; ++k) run(1), fastest_down = std::min(fastest_down, robot.velocity_rad_s);
  EXPECT_NEAR(fastest_down, -10 * 2 * std::numbers::pi / 60 / 100, 1e-6);
}

TEST_F(Homing, Bit4InterruptsAndAHaltDoesNot) {
  begin(-1, 17);
  run(500);
  control(0x11F);
  run(500);
  EXPECT_EQ(robot.velocity_rad_s, 0);
  control(0x1F);
  run(500);
  EXPECT_LT(robot.velocity_rad_s, 0);
  control(0x0F);
  EXPECT_TRUE(until(reached));  // stands, found nothing
  const double here = robot.position_rad;
  run(500);
  EXPECT_EQ(robot.position_rad, here);
  control(0x1F);
  EXPECT_TRUE(until(attained | reached));
}

// No method, a limit switch where the pulse should have been, and a following drive without a switch.
TEST_F(Homing, Errors) {
  begin(0, 0);
  EXPECT_TRUE(until(error | reached));
  control(0x0F);
  nmt(0x81);
  SetUp();
  begin(-2 + degree + 1e-5, 33);  // the switch comes before the pulse
  EXPECT_TRUE(until(error | reached));
  EXPECT_GT(robot.position_rad, -2);
  for (const int method : {3, 19, 36, -1}) EXPECT_EQ(write(0x6098, 0, Type::i8, method), 0x06090030U);
  DriveParameters endless = parameters;
  endless.limited = false;
  EXPECT_EQ(drive_dictionary(parameters).get(0x60E3), 8);
  EXPECT_EQ(drive_dictionary(endless).get(0x60E3), 4);
  EXPECT_EQ(drive_dictionary(endless).get(0x60E3, 1), 33);
}

// A set point after homing counts from the new zero.
TEST_F(Homing, PositionsCountFromHome) {
  begin(0.5, 37);
  EXPECT_TRUE(until(attained | reached));
  EXPECT_EQ(node.dictionary().get(0x6064), 0);
  EXPECT_EQ(write(0x6060, 0, Type::i8, 1), 0U);
  EXPECT_EQ(write(0x607A, 0, Type::i32, std::llround(-0.25 * per_rad)), 0U);
  control(0x0F);
  control(0x1F);
  run(3000);
  EXPECT_NEAR(robot.position_rad, 0.25, 1e-6);
  EXPECT_NEAR(position(), -0.25, 1e-6);
}

TEST_F(Homing, DigitalInputs) {
  EXPECT_EQ(write(0x2130, 1, Type::i32, std::llround(0.5 * per_rad)), 0U);
  EXPECT_EQ(write(0x2130, 2, Type::i32, std::llround(1.5 * per_rad)), 0U);
  struct Row {
    double joint_rad;
    std::int64_t word;
  } rows[] = {{-2, 1}, {-1.98, 0x0}, {0.49, 0}, {0.51, 4}, {1.51, 0x10004}, {1.99, 0x10006}};
  for (const auto& row : rows) {
    robot.position_rad = row.joint_rad;
    node.feedback(robot, 1e-3);
    EXPECT_EQ(node.dictionary().get(0x60FD), row.word) << row.joint_rad;
  }
}

}  // namespace
}  // namespace tribotwin::hil
