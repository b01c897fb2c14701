// Any master: modes, handshakes and parameters at random, at any moment of a motion.
#include <array>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <random>

#include <tribotwin/hil/cia402/modes.hpp>
#include <tribotwin/tests/hil/cia402/one_node.hpp>

namespace tribotwin::hil {
namespace {

class RandomMaster : public OneNode {
 protected:
  std::mt19937 random{19};
  // More by hand: TRIBOTWIN_ROUNDS=1000000.
  const int rounds = std::getenv("TRIBOTWIN_ROUNDS") ? std::atoi(std::getenv("TRIBOTWIN_ROUNDS")) : 200'000;

  std::int64_t any_of(const Object& o) {
    const auto below = [&](int end) { return std::uniform_int_distribution<std::int64_t>(0, end)(random); };
    const std::array<std::int64_t, 6> values{o.low,     o.high,          o.value, static_cast<std::int32_t>(random()),
                                             below(99), below(9'999'999)};
    return values[random() % values.size()];
  }
  /// An object of the drive profile or of the inputs, with a value at random; refused ones are part of it.
  void write_any() {
    const auto objects = node.dictionary().objects();
    const Object& o = objects[random() % objects.size()];
    const bool spared =
        o.index == 0x6040 || o.index == 0x6060 || o.index == 0x6007 || o.index == 0x6065 || o.index == 0x60B1;
    if ((o.index < 0x6000 && o.index != 0x2130) || spared || o.type == Type::text) return;
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(size_of(o.type)));
    encode(any_of(o), bytes);
    (void)node.dictionary().write(o.index, o.sub, bytes);
  }
  /// An object of the ramps, with a value that a master may mean.
  void write_motion() {
    struct Row {
      std::uint16_t index;
      std::uint8_t sub;
      Type type;
    };
    constexpr Row rows[] = {{0x607A, 0, Type::i32}, {0x60FF, 0, Type::i32}, {0x60C1, 1, Type::i32},
                            {0x6081, 0, Type::u32}, {0x6082, 0, Type::u32}, {0x6083, 0, Type::u32},
                            {0x6084, 0, Type::u32}, {0x60A4, 1, Type::u32}, {0x607F, 0, Type::u32},
                            {0x609A, 0, Type::u32}, {0x6099, 1, Type::u32}, {0x6080, 0, Type::u32}};
    const Row& row = rows[random() % std::size(rows)];
    const double size = std::pow(10, std::uniform_real_distribution(row.index == 0x6080 ? 1. : 4., 8.)(random));
    const double sign = row.type == Type::i32 && random() % 2 ? -1 : 1;
    write(row.index, row.sub, row.type, std::llround(sign * size));
    if (random() % 4 == 0) write(0x6086, 0, Type::i16, random() % 2 ? 3 : 0);
    if (random() % 4 == 0) write(0x6098, 0, Type::i8, std::array{1, 2, 17, 18, 33, 34, 35, 37}[random() % 8]);
  }
  void say_any() {
    constexpr std::uint16_t words[] = {0x0F, 0x1F, 0x3F, 0x5F, 0x7F, 0x2F, 0x10F, 0x11F, 0x02, 0x06, 0x07, 0x80, 0x00};
    control(words[random() % std::size(words)]);
  }
  void choose_any() {
    const auto modes = modes_of_operation();
    const std::int64_t number = random() % 8 ? modes[random() % modes.size()].number : no_mode;
    send(0x305, {0x0F, 0, static_cast<std::uint8_t>(number)});
  }
};

// Every set point is a number; none is faster than 6080h or than the joint was before, and none is further from the
// joint than that speed leads; without power there is none.
TEST_F(RandomMaster, SetPointsStayWithinTheMotor) {
  const auto wake = [&] {
    nmt(1);
    write(0x6065, 0, Type::u32, 0xffffffff);
    for (const std::uint16_t word : {0x80, 0x06, 0x07, 0x0F}) control(word);
  };
  wake();
  double last_rad_s = 0;
  std::array<int, 11> followed{};
  for (int k = 0; k < rounds; ++k) {
    const unsigned dice = random() % 64;
    if (dice < 8) write_any();
    if (dice >= 8 && dice < 24) write_motion();
    if (dice >= 24 && dice < 44) say_any();
    if (dice >= 44 && dice < 48) choose_any();
    if (dice == 48 && random() % 4 == 0) nmt(0x81);
    if (dice == 49) nmt(0x80);
    if (dice >= 48 || std::abs(robot.position_rad) > 1000) wake();
    for (int step = static_cast<int>(random() % 40); step > 0; --step) {
      const double limit = static_cast<double>(node.dictionary().get(0x6080)) * std::numbers::pi / 30 / 100;
      const double fastest = std::max({limit, last_rad_s, std::abs(robot.velocity_rad_s)}) * (1 + 1e-9) + 1e-9;
      const double before = robot.position_rad;
      run(1);
      last_rad_s = std::abs(robot.velocity_rad_s);
      ASSERT_TRUE(std::isfinite(robot.position_rad) && std::isfinite(last_rad_s)) << k;
      ASSERT_LE(last_rad_s, fastest) << "round " << k << ", mode " << node.dictionary().get(0x6061);
      ASSERT_LE(std::abs(robot.position_rad - before), 1e-3 * fastest + 1e-9)
          << "round " << k << ", mode " << node.dictionary().get(0x6061);
      if (node.enabled()) ++followed[static_cast<std::size_t>(node.dictionary().get(0x6061))];
    }
    bus.clear();
  }
  for (const ModeOfOperation& mode : modes_of_operation())
    EXPECT_GT(followed[static_cast<std::size_t>(mode.number)], rounds / 50) << mode.name;
}

}  // namespace
}  // namespace tribotwin::hil
