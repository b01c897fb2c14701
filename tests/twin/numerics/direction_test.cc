#include <gmock/gmock.h>

#include <tribotwin/twin/numerics/direction.hpp>

namespace tribotwin::twin::identification {
namespace {

using Signal = std::vector<double>;

struct Case {
  const char* name;
  Signal speed, direction;
  std::vector<bool> rest;
};

// Slow is below 1, far is from 1.5 on; a turn lasts at most 3 samples.
TEST(Sliding, IsInTheDirectionOfMotionAndAtRestOfThatBesideIt) {
  for (const auto& c : {
           Case{"a turn between two samples", {2, 1, -1, -2}, {1, 1, -1, -1}, {0, 0, 0, 0}},
           Case{"a turn where the speed crosses", {2, .9, .1, -.2, -2}, {1, 1, 1, -1, -1}, {0, 0, 0, 0, 0}},
           Case{"noise while it turns: one crossing", {2, -.1, .2, -.3, -2}, {1, 1, -1, -1, -1}, {0, 0, 0, 0, 0}},
           Case{"it slows down and goes on", {2, .2, -.1, 2}, {1, 1, 1, 1}, {0, 0, 0, 0}},
           Case{"noise about standstill", {2, .2, -.2, .2, -.2, -2}, {1, 1, 1, -1, -1, -1}, {0, 1, 1, 1, 1, 0}},
           Case{"it creeps for long", {2, .2, .2, .2, .2, 2}, {1, 1, 1, 1, 1, 1}, {0, 1, 1, 1, 1, 0}},
           Case{"a turn at the ends", {-.1, .1, 2, .1, -.1}, {-1, 1, 1, 1, -1}, {0, 0, 0, 0, 0}},
           Case{"rest at the ends",
                {0, 0, 0, 0, 2, 0, 0, 0, 0},
                {1, 1, 1, 1, 1, 1, 1, 1, 1},
                {1, 1, 1, 1, 0, 1, 1, 1, 1}},
           Case{"it swings to rest",
                {2, 2, -1.2, .5, 1.1, .2, -2, -2},
                {1, 1, 1, 1, -1, -1, -1, -1},
                {0, 0, 1, 1, 1, 1, 0, 0}},
           Case{"it stands", {.1, -.1, .1, -.1}, {0, 0, 0, 0}, {1, 1, 1, 1}},
           Case{"nothing", {}, {}, {}},
       }) {
    const Sliding s = sliding_of(c.speed, 1, 1.5, 3);
    EXPECT_EQ(s.direction, c.direction) << c.name;
    EXPECT_EQ(s.rest, c.rest) << c.name;
  }
}

TEST(Sliding, RestsReachBothWays) {
  using Flags = std::vector<bool>;
  EXPECT_EQ(widened(Flags{0, 0, 0, 1, 0, 0, 0}, 2), (Flags{0, 1, 1, 1, 1, 1, 0}));
  EXPECT_EQ(widened(Flags{1, 0, 0, 1, 0}, 1), (Flags{1, 1, 1, 1, 1}));
  EXPECT_EQ(widened(Flags{0, 0}, 5), (Flags{0, 0}));
}

}  // namespace
}  // namespace tribotwin::twin::identification
