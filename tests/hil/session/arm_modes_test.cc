// Six IRB 6620 axes in the modes of operation, with gravity, friction and the servo's loops.
#include <array>
#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include <tribotwin/hil/session/bench.hpp>
#include <tribotwin/tests/hil/one_drive.hpp>

namespace tribotwin::hil {
namespace {

constexpr double degree = std::numbers::pi / 180;

twin::Scenario hold() {
  return twin::load_scenario(std::string(TRIBOTWIN_SOURCE_DIR) + "/twin/scenarios/irb6620_hold.yaml").value();
}

/// Six drives and their robot on an imaginary bus, with a cycle of 2 ms.
struct ArmBench {
  twin::Scenario scenario;
  std::vector<Frame> bus;
  Bench bench{scenario, {}, record_in(bus)};
  std::int64_t now = 0;

  explicit ArmBench(twin::Scenario s = hold()) : scenario(std::move(s)) { bench.start(now); }
  Node& node(std::size_t axis) { return dynamic_cast<Node&>(*bench.drives()[axis]); }
  std::uint32_t id(std::uint32_t base, std::size_t axis) { return base + static_cast<std::uint32_t>(axis) + 1; }
  void give(std::uint32_t to, std::vector<std::uint8_t> bytes = {}) {
    ASSERT_TRUE(bench.receive(classic(to, bytes), now));
  }
  void write(std::size_t axis, std::uint16_t index, std::uint8_t sub, Type type, std::int64_t value) {
    bus.clear();
    give(id(0x600, axis), download(index, sub, type, value));
    for (const Frame& frame : bus)
      if (frame.id == id(0x580, axis)) EXPECT_NE(frame.data[0], 0x80) << text(frame);
  }
  std::int64_t value(std::size_t axis, std::uint16_t index) { return node(axis).dictionary().get(index); }
  void control(std::size_t axis, std::uint16_t word) {
    give(id(0x200, axis), {static_cast<std::uint8_t>(word), static_cast<std::uint8_t>(word >> 8)});
  }
  void enable_all() {
    give(0, {1, 0});
    for (std::size_t i = 0; i < 6; ++i)
      for (const std::uint16_t word : {0x06, 0x07, 0x0F}) control(i, word);
  }
  void cycle() {
    now += 2 * ms;
    ASSERT_TRUE(bench.tick(now));
    give(0x80);
    bus.clear();
  }
  double joint_rad(std::size_t axis) { return bench.plant().twin().data()->qpos[axis]; }
  double per_rad(std::size_t axis) { return 65536 * node(axis).parameters().gear_ratio / (2 * std::numbers::pi); }
};

class Arm : public testing::Test, protected ArmBench {};

// 5 degrees at 0.5 Hz, all axes at once: the worst distance from the master's path.
class Sine : public Arm {
 protected:
  std::array<double, 6> follow() {
    enable_all();
    std::array<double, 6> worst_rad{};
    for (int k = 0; k < 3000; ++k) {
      const double t = 2e-3 * (k + 1), fade = std::min(1.0, t / 2);
      const double path = 5 * degree * fade * fade * (3 - 2 * fade) * std::sin(std::numbers::pi * t);
      for (std::size_t i = 0; i < 6; ++i) {
        std::vector<std::uint8_t> data{0x0F, 0, 0, 0, 0, 0};
        encode(std::llround((scenario.start_rad[i] + path) * per_rad(i)), std::span(data).subspan(2));
        give(id(0x400, i), data);
      }
      cycle();
      for (std::size_t i = 0; i < 6; ++i)
        worst_rad[i] = std::max(worst_rad[i], std::abs(joint_rad(i) - scenario.start_rad[i] - path));
    }
    return worst_rad;
  }
};

TEST_F(Sine, SixAxesFollowWithTheDefaultGains) {
  const auto worst_rad = follow();
  for (std::size_t i = 0; i < 6; ++i) EXPECT_LT(worst_rad[i], 0.2 * degree) << "axis " << i + 1;
}

// 60F9h and 60FBh are the gains of the loops: the twin's own, softer ones.
TEST_F(Sine, SoftGainsFollowLess) {
  write(5, 0x60F9, 1, Type::u16, 600);
  write(5, 0x60F9, 2, Type::u16, 1000);
  write(5, 0x60FB, 1, Type::u16, 1000);
  const auto worst_rad = follow();
  EXPECT_GT(worst_rad[5], 0.5 * degree);
  EXPECT_LT(worst_rad[4], 0.2 * degree);
  EXPECT_EQ(value(4, 0x60FB), 1);  // highest sub-index
}

// A scenario with a servo of its own has its gains.
TEST(ArmParameters, GainsOfTheScenario) {
  auto scenario = twin::load_scenario(std::string(TRIBOTWIN_SOURCE_DIR) + "/twin/scenarios/irb6620_hold.yaml").value();
  EXPECT_EQ(drive_parameters(scenario, 1, 2000)[0].gains.position_gain_1_s, 20);
  scenario.control =
      twin::CascadedOptions{.position_gain_1_s = 7, .speed_bandwidth_rad_s = 33, .integral_time_s = 0.25};
  const Dictionary d = drive_dictionary(drive_parameters(scenario, 1, 2000)[0]);
  EXPECT_EQ(d.get(0x60F9, 1), 330);
  EXPECT_EQ(d.get(0x60F9, 2), 2500);
  EXPECT_EQ(d.get(0x60FB, 1), 700);
  EXPECT_EQ(d.find(0x60F9, 1)->high, 10000);  // 1 / time step of 1 ms
}

// Profile position moves every axis by 10 degrees and there says that it is there.
TEST_F(Arm, ProfilePositionArrives) {
  for (std::size_t i = 0; i < 6; ++i) write(i, 0x6060, 0, Type::i8, 1);
  enable_all();
  for (std::size_t i = 0; i < 6; ++i) {
    write(i, 0x607A, 0, Type::i32, std::llround((scenario.start_rad[i] + 10 * degree) * per_rad(i)));
    control(i, 0x1F);
    EXPECT_EQ(value(i, 0x6041) & 0x1400, 0x1000);
  }
  for (int k = 0; k < 1000; ++k) cycle();
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(node(i).state(), DriveState::operation_enabled) << i;
    EXPECT_EQ(value(i, 0x6041) & 0x0400, 0x0400) << i;
    EXPECT_NEAR(joint_rad(i), scenario.start_rad[i] + 10 * degree, 0.001) << i;
  }
}

TEST_F(Arm, ProfileVelocityTurns) {
  for (std::size_t i = 0; i < 6; ++i) write(i, 0x6060, 0, Type::i8, 3);
  enable_all();
  for (std::size_t i = 0; i < 6; ++i) write(i, 0x60FF, 0, Type::i32, 100'000);  // 100 rpm
  for (int k = 0; k < 400; ++k) cycle();
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(value(i, 0x6041) & 0x1400, 0x0400) << i;
    EXPECT_NEAR(1e-3 * static_cast<double>(value(i, 0x606C)), 100, 2) << i;
    write(i, 0x60FF, 0, Type::i32, 0);
  }
  for (int k = 0; k < 200; ++k) cycle();
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(value(i, 0x6041) & 0x1400, 0x1400) << i;
}

// The real joint stops on the limit switch before the end of its range, and home is where the switch opens.
TEST(ArmHoming, FindsTheLimitSwitches) {
  for (const int method : {17, 2})
    for (std::size_t axis = 0; axis < 6; ++axis) {
      SCOPED_TRACE(testing::Message() << "method " << method << ", axis " << axis + 1);
      const DriveParameters p = drive_parameters(hold(), 1, 2000)[axis];
      const double end = method == 17 ? p.position_low_rad : p.position_high_rad, way = method == 17 ? -1 : 1;
      twin::Scenario near = hold();
      near.start_rad[axis] = end - way * 8 * degree;
      ArmBench arm(near);
      arm.write(axis, 0x6060, 0, Type::i8, 6);
      arm.write(axis, 0x6098, 0, Type::i8, method);
      arm.enable_all();
      arm.cycle();
      arm.control(axis, 0x1F);
      double furthest = -1e9;
      for (int k = 0; k < 6000 && (arm.value(axis, 0x6041) & 0x1400) != 0x1400; ++k) {
        arm.cycle();
        furthest = std::max(furthest, way * arm.joint_rad(axis));
      }
      EXPECT_EQ(arm.value(axis, 0x6041) & 0x3400, 0x1400);
      EXPECT_GT(furthest, way * end - degree);
      EXPECT_LT(furthest, way * end);
      const double turn = 2 * std::numbers::pi / p.gear_ratio, opens = end - way * degree;
      const double home = method == 17 ? opens : std::floor(opens / turn) * turn;
      EXPECT_NEAR(static_cast<double>(arm.value(axis, 0x6064)), (arm.joint_rad(axis) - home) * arm.per_rad(axis), 2);
    }
}

// The torque is gone within a step, and the brake holds what it held.
TEST_F(Arm, SafeTorqueOffDropsNothing) {
  enable_all();
  for (int k = 0; k < 100; ++k) cycle();
  ASSERT_GT(std::abs(bench.plant().twin().drive(1).torque_nm), 10);
  const double before = joint_rad(1);
  bench.plant().impose({.kind = FaultKind::safe_torque_off, .drive = 1, .on = true});
  for (int k = 0; k < 500; ++k) cycle();
  EXPECT_EQ(bench.plant().twin().drive(1).torque_nm, 0);
  EXPECT_EQ(node(1).state(), DriveState::fault);
  EXPECT_NEAR(joint_rad(1), before, 0.1 * degree);
  EXPECT_EQ(node(0).state(), DriveState::operation_enabled);
}

}  // namespace
}  // namespace tribotwin::hil
