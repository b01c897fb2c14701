// A velocity beside positions: what is proven to be none of theirs, and what only looks so.
#include <cmath>
#include <numbers>
#include <random>

#include <gtest/gtest.h>

#include <tribotwin/twin/identification/time_series.hpp>

namespace tribotwin::twin::identification {
namespace {

struct Recorded {
  std::vector<double> time_s, position, velocity;

  std::optional<VelocityRatio> ratio() const { return velocity_over_slope(time_s, position, velocity); }
};

/// 20 s at 100 Hz: `amplitude` sin 2t + `creep` t, on an encoder of `step`; the velocity has white noise.
Recorded recorded(double amplitude, double creep, double step, double noise) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal(0, noise);
  Recorded r;
  for (int i = 0; i < 2000; ++i) {
    const double t = 0.01 * i, q = amplitude * std::sin(2 * t) + creep * t;
    r.time_s.push_back(t);
    r.position.push_back(std::round(q / step) * step);
    r.velocity.push_back(2 * amplitude * std::cos(2 * t) + creep + normal(random));
  }
  return r;
}

TEST(VelocityOverSlope, OfAJointAtRestSaysNothing) {
  EXPECT_FALSE(recorded(0, 0, 6e-4, 0.011).ratio());
  EXPECT_FALSE(recorded(0, 4e-4, 6e-4, 0.011).ratio()) << "creep over 12 values of the encoder";
}

TEST(VelocityOverSlope, IsOneWhateverTheEncoder) {
  for (const double step : {1e-6, 6e-4, 2e-2}) {
    const auto ratio = recorded(0.1, 0, step, 0.02).ratio();
    ASSERT_TRUE(ratio) << step;
    EXPECT_NEAR(ratio->value, 1, 0.2) << step;
    EXPECT_LT(ratio->sigma, 0.05) << step;
    EXPECT_FALSE(ratio->contradicts()) << step;
  }
}

TEST(VelocityOverSlope, AnotherColumnContradicts) {
  for (const double factor : {180 / std::numbers::pi, std::numbers::pi / 180, -1.0, 0.0, 2.5, 0.4}) {
    Recorded r = recorded(0.1, 0, 6e-4, 0.002);
    for (double& v : r.velocity) v *= factor;
    const auto ratio = r.ratio();
    ASSERT_TRUE(ratio) << factor;
    EXPECT_TRUE(ratio->contradicts()) << factor;
    EXPECT_NEAR(ratio->value, factor, 0.02 * std::abs(factor) + 1e-12);
    EXPECT_EQ(ratio->text("q").ends_with("degrees"), std::abs(std::log(std::abs(factor))) > 3 && factor != 0);
  }
  Recorded other = recorded(0.1, 0, 6e-4, 0.002);
  for (std::size_t i = 0; i < other.velocity.size(); ++i) other.velocity[i] = 0.2 * std::cos(3.1 * other.time_s[i]);
  EXPECT_TRUE(other.ratio()->contradicts()) << "that of another joint";
}

}  // namespace
}  // namespace tribotwin::twin::identification
