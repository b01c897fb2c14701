#include <gtest/gtest.h>

#include <tribotwin/hil/motion/inputs.hpp>

namespace tribotwin::hil {
namespace {

// The index pulse comes at whole turns, from either side, however far the step.
TEST(Inputs, IndexPulses) {
  struct Row {
    double from, to;
    bool pulse;
    double at;
  } rows[] = {{0.1, 0.9, false, 0}, {0.9, 1.1, true, 1}, {1.1, 0.9, true, 1}, {-0.1, 0.1, true, 0},
              {0.1, -0.1, true, 0}, {1, 1.5, false, 0},  {0.5, 1, true, 1},   {0.5, 3.5, true, 1}};
  for (const auto& row : rows) {
    SCOPED_TRACE(row.from);
    Inputs inputs;
    inputs.move_to({}, row.from);
    EXPECT_FALSE(inputs.edge(Input::index).rising);
    inputs.move_to({}, row.to);
    EXPECT_EQ(inputs.edge(Input::index).rising, row.pulse);
    if (row.pulse) EXPECT_EQ(inputs.edge(Input::index).position_rad, row.at);
  }
}

// A switch closes at its position, from whichever side, and says once that it did.
TEST(Inputs, SwitchesAndTheirEdges) {
  const SwitchPositions s{.negative_limit_rad = -1, .positive_limit_rad = 1, .home_rad = 0.25, .probe_2_rad = 5};
  Inputs inputs;
  inputs.move_to(s, -1.5);
  EXPECT_TRUE(inputs.active(Input::negative_limit));
  EXPECT_FALSE(inputs.edge(Input::negative_limit).rising);
  inputs.move_to(s, 0.5);
  EXPECT_TRUE(inputs.edge(Input::negative_limit).falling);
  EXPECT_EQ(inputs.edge(Input::negative_limit).position_rad, -1);
  EXPECT_TRUE(inputs.edge(Input::home).rising);
  EXPECT_EQ(inputs.edge(Input::home).position_rad, 0.25);
  inputs.move_to(s, 0.6);
  EXPECT_TRUE(inputs.active(Input::home));
  EXPECT_FALSE(inputs.edge(Input::home).rising || inputs.edge(Input::home).falling);
  EXPECT_FALSE(inputs.active(Input::positive_limit) || inputs.active(Input::probe_2));
}

TEST(Inputs, LimitSwitchesAreOfTheRange) {
  EXPECT_EQ(switches_of({.limited = true, .position_low_rad = -2, .position_high_rad = 3}).positive_limit_rad,
            3 - limit_switch_margin_rad);
  Inputs inputs;
  inputs.move_to(switches_of({.limited = false}), 1e9);
  EXPECT_FALSE(inputs.active(Input::positive_limit) || inputs.active(Input::negative_limit));
}

}  // namespace
}  // namespace tribotwin::hil
