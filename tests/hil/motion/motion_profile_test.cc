// Ramps against closed forms, and random ones against their limits and against numerical integration.
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include <tribotwin/hil/motion/motion_profile.hpp>

namespace tribotwin::hil {
namespace {

constexpr double inf = MotionLimits::unlimited;

// Rest to rest; the duration in closed form.
TEST(MotionProfile, DurationsOfTheTextbook) {
  struct Row {
    const char* shape;
    MotionLimits limits;
    double way_rad, duration_s;
  } rows[] = {{"trapezoid: X/v + v/2a + v/2d", {2, 4, 8, inf}, 10, 10. / 2 + 2. / 8 + 2. / 16},
              {"triangle: v = sqrt(2 X a d / (a + d)), T = v/a + v/d", {100, 4, 4, inf}, 1, 1},
              {"seven segments: X/v + v/a + a/j", {2, 4, 4, 16}, 10, 10. / 2 + 2. / 4 + 4. / 16},
              {"without a constant acceleration: X/v + 2 sqrt(v/j)", {1, 4, 4, 4}, 10, 10 + 2 * 0.5},
              {"without either: 4 cbrt(X/2j)", {100, 100, 100, 4}, 1, 4 * std::cbrt(1. / 8)}};
  for (const auto& row : rows)
    for (const double sign : {1.0, -1.0}) {
      SCOPED_TRACE(row.shape);
      const MotionProfile p = position_profile(row.limits, {3}, 3 + sign * row.way_rad);
      EXPECT_NEAR(p.duration_s(), row.duration_s, 1e-12);
      EXPECT_EQ(p.at(1e9).speed_rad_s, 0);
      EXPECT_EQ(p.at(row.duration_s + 1).position_rad, 3 + sign * row.way_rad);
    }
}

TEST(MotionProfile, StandsWhereItIsToBe) {
  const MotionProfile p = position_profile({}, {1.5}, 1.5);
  EXPECT_EQ(p.duration_s(), 0);
  EXPECT_EQ(p.at(0).position_rad, 1.5);
  EXPECT_EQ(p.at(7).position_rad, 1.5);
}

// The end speed, in the direction of arrival; less where the way is too short for it: v = sqrt(2 a X).
TEST(MotionProfile, EndSpeeds) {
  EXPECT_EQ(position_profile({2, 4, 4, inf}, {}, -10, 1).end().speed_rad_s, -1);
  EXPECT_NEAR(position_profile({2, 4, 4, inf}, {}, 0.1, 2).end().speed_rad_s, std::sqrt(2 * 4 * 0.1), 1e-12);
  EXPECT_EQ(position_profile({2, 4, 4, inf}, {}, 10, 5).end().speed_rad_s, 2);
  const MotionProfile p = position_profile({2, 4, 4, 16}, {}, 10, 1);
  EXPECT_NEAR(p.at(p.duration_s() + 0.5).position_rad, 10.5, 1e-12);
}

/// Samples of a profile, and what must hold for them.
class Checked {
 public:
  Checked(const MotionLimits& limits, const MotionState& start, const MotionProfile& profile)
      : limits_(limits), p_(profile) {
    const bool smooth = std::isfinite(limits.jerk_rad_s3);
    begin_ = start;
    if (!smooth) begin_.acceleration_rad_s2 = 0;
    const double coasting =
        start.speed_rad_s +
        (smooth ? start.acceleration_rad_s2 * std::abs(start.acceleration_rad_s2) / (2 * limits.jerk_rad_s3) : 0);
    fastest_ = std::max({limits.speed_rad_s, std::abs(start.speed_rad_s), std::abs(coasting)});
    strongest_ =
        std::max({limits.acceleration_rad_s2, limits.deceleration_rad_s2, std::abs(begin_.acceleration_rad_s2)});
  }

  /// Speed, acceleration, and the steps of both: jerk, and the integrals of what is sampled.
  void all() {
    constexpr int samples = 300;
    const double h = p_.duration_s() / samples;
    MotionState last = begin_;
    EXPECT_NEAR(p_.at(0).position_rad, begin_.position_rad, 1e-12);
    EXPECT_NEAR(p_.at(0).speed_rad_s, begin_.speed_rad_s, 1e-12);
    for (int k = 1; k <= samples; ++k) {
      const MotionState s = p_.at(k * h);
      limits(s);
      step(last, s, h, k == 1);
      last = s;
      if (testing::Test::HasFailure()) return;
    }
  }

 private:
  void limits(const MotionState& s) const {
    EXPECT_LE(std::abs(s.speed_rad_s), fastest_ + 1e-9);
    const bool grows = s.speed_rad_s * s.acceleration_rad_s2 > 0;
    // From rest of the acceleration on, each side of standstill has its own limit.
    const bool own = begin_.acceleration_rad_s2 == 0 && std::abs(s.speed_rad_s) > 1e-9;
    const double allowed = !own ? strongest_ : grows ? limits_.acceleration_rad_s2 : limits_.deceleration_rad_s2;
    EXPECT_LE(std::abs(s.acceleration_rad_s2), allowed + 1e-9);
  }
  void step(const MotionState& last, const MotionState& s, double h, bool first) const {
    if (std::isfinite(limits_.jerk_rad_s3)) {
      const double jerk = limits_.jerk_rad_s3;
      EXPECT_LE(std::abs(s.acceleration_rad_s2 - last.acceleration_rad_s2), jerk * h + 1e-9);
      // Trapezoidal rule; exact but for steps of the jerk.
      EXPECT_NEAR(s.speed_rad_s - last.speed_rad_s, h / 2 * (last.acceleration_rad_s2 + s.acceleration_rad_s2),
                  jerk * h * h / 2 + 1e-9);
    } else if (!first) {
      EXPECT_LE(std::abs(s.speed_rad_s - last.speed_rad_s), strongest_ * h + 1e-9);
    }
    EXPECT_NEAR(s.position_rad - last.position_rad, h / 2 * (last.speed_rad_s + s.speed_rad_s),
                strongest_ * h * h / 2 + 1e-9);
  }

  const MotionLimits& limits_;
  const MotionProfile& p_;
  MotionState begin_;
  double fastest_, strongest_;
};

/// The furthest position in the direction of `sign`: at an end or where the motion turns round.
double furthest(const MotionProfile& p, double sign) {
  constexpr int samples = 500;
  const auto time = [&](int k) { return p.duration_s() * k / samples; };
  double most = std::max(sign * p.at(0).position_rad, sign * p.end().position_rad);
  for (int k = 0; k < samples; ++k) {
    double before = time(k), after = time(k + 1);
    const double speed = p.at(before).speed_rad_s;
    if (speed * p.at(after).speed_rad_s > 0) continue;
    for (int i = 0; i < 60; ++i) {
      const double middle = (before + after) / 2;
      (speed * p.at(middle).speed_rad_s > 0 ? before : after) = middle;
    }
    most = std::max(most, sign * p.at(before).position_rad);
  }
  return most;
}

// Too fast to stop in time: it overshoots by what it must, and returns.
TEST(MotionProfile, ReturnsWhereItCannotStop) {
  const MotionProfile p = position_profile({2, 4, 4, inf}, {0, 2}, 0.25);  // stops after 0.5
  EXPECT_NEAR(furthest(p, 1), 0.5, 1e-12);
  EXPECT_EQ(p.end().position_rad, 0.25);
  EXPECT_EQ(p.end().speed_rad_s, 0);
}

// Limits that fall on the way: the speed stays, the jerk does not.
TEST(MotionProfile, TheSpeedCountsMoreThanTheJerk) {
  const MotionLimits limits{2, 4, 4, 1};
  EXPECT_NEAR(speed_profile(limits, {0, 1, 4}, 2).at(4).speed_rad_s, 9, 1e-9);  // v + a^2 / 2j
  for (const double sign : {1.0, -1.0}) {
    const MotionState s = within_speed(limits, {0, sign, 4 * sign});
    EXPECT_NEAR(s.acceleration_rad_s2, sign * std::sqrt(2), 1e-12);
    EXPECT_EQ(within_speed(limits, {0, 3 * sign, sign}).acceleration_rad_s2, 0);
    EXPECT_EQ(within_speed(limits, {0, 3 * sign, -2 * sign}).acceleration_rad_s2, -2 * sign);
    EXPECT_EQ(within_speed({2, 4, 4, inf}, {0, sign, 4 * sign}).acceleration_rad_s2, 4 * sign);
  }
}

/// New targets and limits at any moment of a motion, again and again.
class RandomMotion : public testing::TestWithParam<bool> {
 protected:
  std::mt19937 random{7};
  double any(double low, double high) { return std::uniform_real_distribution(low, high)(random); }
  double any_scale() { return std::pow(10.0, any(-1, 1.5)); }
  MotionLimits any_limits() {
    MotionLimits l{any_scale(), any_scale(), any_scale(), GetParam() ? any_scale() * 10 : inf};
    if (random() % 2) l.deceleration_rad_s2 = l.acceleration_rad_s2;
    return l;
  }
};

TEST_P(RandomMotion, ArrivesExactlyWithinItsLimits) {
  MotionState now;
  for (int k = 0; k < 20'000; ++k) {
    SCOPED_TRACE(k);
    const MotionLimits limits = any_limits();
    const double target = random() % 8 ? any(-20, 20) : now.position_rad + any(-0.01, 0.01);
    const double end_speed = random() % 4 ? 0 : any_scale();
    const MotionProfile p = position_profile(limits, now, target, end_speed);
    Checked(limits, now, p).all();
    EXPECT_EQ(p.at(p.duration_s()).position_rad, target);
    const double just_before_s = p.duration_s() * (1 - 1e-13);
    EXPECT_NEAR(p.at(just_before_s).position_rad, target, 1e-9 + 100 * (p.duration_s() - just_before_s));
    EXPECT_LE(std::abs(p.end().speed_rad_s), end_speed);
    const MotionProfile stop = speed_profile(limits, now, 0);
    const double sign = target >= stop.end().position_rad ? 1 : -1;
    EXPECT_LE(furthest(p, sign), std::max(sign * target, furthest(stop, sign)) + 1e-9);
    if (HasFailure()) return;
    now = random() % 4 ? p.at(any(0, 1) * p.duration_s()) : MotionState{target};
  }
}

TEST_P(RandomMotion, ReachesSpeedsWithinItsLimits) {
  MotionState now;
  for (int k = 0; k < 20'000; ++k) {
    SCOPED_TRACE(k);
    const MotionLimits limits = any_limits();
    const double speed = random() % 4 ? any(-20, 20) : 0;
    const MotionProfile p = speed_profile(limits, now, speed);
    Checked(limits, now, p).all();
    EXPECT_EQ(p.end().speed_rad_s, std::clamp(speed, -limits.speed_rad_s, limits.speed_rad_s));
    if (HasFailure()) return;
    now = p.at(any(0, 1) * p.duration_s());
    now.position_rad = 0;
  }
}

// A profile that is made anew in each step from the last set point is the profile that was made once.
TEST_P(RandomMotion, StepsAreTheProfile) {
  for (int k = 0; k < 300; ++k) {
    SCOPED_TRACE(k);
    const MotionLimits limits = any_limits();
    const double speed = any(-20, 20), dt = 1e-3;
    const MotionProfile p = speed_profile(limits, {}, speed);
    MotionState now;
    for (int i = 1; i <= std::min(2000.0, p.duration_s() / dt + 10); ++i) {
      now = speed_profile(limits, now, speed).at(dt);
      ASSERT_NEAR(now.speed_rad_s, p.at(i * dt).speed_rad_s, 1e-9);
      ASSERT_NEAR(now.position_rad, p.at(i * dt).position_rad, 1e-9);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Ramps, RandomMotion, testing::Bool(),
                         [](const auto& ramp) { return ramp.param ? "jerk_limited" : "linear"; });

}  // namespace
}  // namespace tribotwin::hil
