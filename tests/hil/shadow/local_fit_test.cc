// Derivatives, means, periods and delays of signals whose answer is known.
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/hil/shadow/cycle_period.hpp>
#include <tribotwin/hil/shadow/lag.hpp>
#include <tribotwin/hil/shadow/local_fit.hpp>

namespace tribotwin::hil {
namespace {

/// A parabola about 1 s at uneven times, with gaps.
Samples parabola() {
  Samples samples;
  for (int k = -60; k <= 60; ++k) {
    if (k % 7 == 0 || (k > 20 && k < 26)) continue;
    const double t = 1 + 1e-3 * k + 2e-4 * std::sin(5.0 * k), s = t - 1;
    samples.push_back({t, 2 + 3 * s + 4 * s * s});
  }
  return samples;
}

TEST(LocalFit, FindsAParabola) {
  const Motion m = local_motion(parabola(), 1, 0.06, 1e-5);
  EXPECT_NEAR(m.position, 2, 1e-9);
  EXPECT_NEAR(m.speed, 3, 1e-8);
  EXPECT_NEAR(m.acceleration, 8, 1e-6);
}

// Samples that were taken 20 ms before their stamp.
TEST(LocalFit, LeavesLateSamplesOut) {
  Samples samples = parabola();
  for (const std::size_t i : {10U, 11U, 40U, 70U, 71U, 72U}) samples[i].value -= 0.06;
  const Motion m = local_motion(samples, 1, 0.06, 1e-5);
  EXPECT_NEAR(m.speed, 3, 1e-6);
  EXPECT_NEAR(m.acceleration, 8, 1e-3);
}

// The mean has the weight that a parabola's second derivative has: of the acceleration of t^4, 12 t^2, the same.
TEST(LocalFit, FiltersTorquesAsAccelerations) {
  Samples position, torque;
  for (int k = -600; k <= 600; ++k) {
    const double t = 1e-4 * k;
    position.push_back({t, std::pow(t, 4)});
    torque.push_back({t, 12 * t * t});
  }
  const double acceleration = local_motion(position, 0, 0.06, 1).acceleration, mean = local_mean(torque, 0, 0.06);
  EXPECT_NEAR(acceleration, 12 * 0.06 * 0.06 / 7, 1e-4);
  EXPECT_NEAR(mean, acceleration, 1e-4);
}

TEST(LocalFit, NeedsAFilledWindow) {
  const Samples samples = parabola();
  EXPECT_TRUE(covered(samples, 1, 0.06, 0.01));
  EXPECT_FALSE(covered(samples, 1, 0.06, 0.004));  // the gap inside
  EXPECT_FALSE(covered(samples, 1.02, 0.06, 0.01));
  EXPECT_FALSE(covered(samples, 0.98, 0.06, 0.01));
  EXPECT_FALSE(covered({{1, 0}, {1.001, 0}, {1.002, 0}, {1.003, 0}}, 1, 0.06, 1));
  EXPECT_FALSE(covered({}, 1, 0.06, 1));
}

TEST(CyclePeriod, IsThatOfMostFrames) {
  struct Case {
    const char* name;
    std::vector<double> intervals_ms;  // repeated
    double period_ms, spread;
  };
  for (const Case& c : {Case{"regular", {2}, 2, 0}, Case{"one of five lost", {2, 2, 2, 4}, 2, 0.5},
                        Case{"jitter", {1.9, 2.1, 2.05, 1.95, 2}, 2, 0.05}, Case{"read at once", {0, 0, 0, 8}, 2, 2}}) {
    CyclePeriod period;
    double t = 5;
    EXPECT_FALSE(period.period_s());
    for (std::size_t i = 0; i < 200; ++i) period.add(t), t += 1e-3 * c.intervals_ms[i % c.intervals_ms.size()];
    ASSERT_TRUE(period.period_s()) << c.name;
    EXPECT_TRUE(period.complete());
    EXPECT_EQ(period.count(), CyclePeriod::enough);
    EXPECT_NEAR(1e3 * *period.period_s(), c.period_ms, 0.03) << c.name;
    EXPECT_NEAR(period.spread(), c.spread, 0.03) << c.name;
  }
  CyclePeriod still;
  for (int i = 0; i < 100; ++i) still.add(1);
  EXPECT_FALSE(still.period_s());
}

TEST(Lag, FindsADelay) {
  for (const int delay : {-30, -1, 0, 3, 50}) {
    Lag lag;
    const auto signal = [](int k) { return 1e6 + std::sin(0.013 * k) + std::sin(0.00031 * k * k); };
    for (int k = 0; k < 2000; ++k) lag.add(signal(k), signal(k - delay));
    EXPECT_EQ(lag.samples(), delay);
  }
  Lag constant;
  for (int k = 0; k < 2000; ++k) constant.add(3, 5);
  EXPECT_EQ(constant.samples(), 0);
}

}  // namespace
}  // namespace tribotwin::hil
