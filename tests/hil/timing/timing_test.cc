// What a session measures: lateness of the robot's clock, SYNC and its answer. All times are given.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/hil/timing/pace.hpp>
#include <tribotwin/hil/timing/sync_timing.hpp>

namespace tribotwin::hil {
namespace {

using testing::HasSubstr;

constexpr std::int64_t us = 1000, ms = 1'000'000, s = 1'000'000'000;

TEST(Distribution, QuantilesAreWithinATenthOfAPercent) {
  Distribution d;
  EXPECT_EQ(d.median_ns(), 0);
  for (std::int64_t k = 1; k <= 1000; ++k) d.add(k * 7919);
  EXPECT_EQ(d.count(), 1000U);
  EXPECT_EQ(d.max_ns(), 1000 * 7919);
  for (const double q : {0.001, 0.25, 0.5, 0.99, 1.0})
    EXPECT_NEAR(static_cast<double>(d.quantile_ns(q)), 1e3 * q * 7919, 1e3 * q * 7919 * 1e-3) << q;
  const Distribution around = d.around_median();
  EXPECT_NEAR(static_cast<double>(around.max_ns()), 500 * 7919, 8000);
  EXPECT_NEAR(static_cast<double>(around.median_ns()), 250 * 7919, 8000);
}

TEST(Distribution, TakesAnyDuration) {
  Distribution d;
  for (const std::int64_t ns : {std::numeric_limits<std::int64_t>::min(), std::int64_t{-1}, std::int64_t{0},
                                std::int64_t{1}, std::int64_t{2047}, std::int64_t{2048}, 100 * 3600 * s})
    d.add(ns);
  std::vector<std::int64_t> values;
  d.each([&](std::int64_t ns, std::uint64_t times) { values.insert(values.end(), times, ns); });
  EXPECT_THAT(values, testing::ElementsAre(0, 0, 0, 1, 2047, testing::AllOf(testing::Ge(2048), testing::Le(2050)),
                                           testing::Gt(4 * 3600 * s)));
}

TEST(Distribution, HistogramHasEveryDurationBetweenItsLimits) {
  Distribution d;
  EXPECT_TRUE(d.histogram_us().empty());
  for (const int us : {3, 7, 7, 12, 39}) d.add(us * 1000);
  using Bins = std::vector<std::pair<std::int64_t, std::uint64_t>>;
  EXPECT_EQ(d.histogram_us(), (Bins{{4, 1},
                                    {5, 0},
                                    {6, 0},
                                    {7, 0},
                                    {8, 2},
                                    {10, 0},
                                    {12, 0},
                                    {14, 1},
                                    {16, 0},
                                    {20, 0},
                                    {24, 0},
                                    {28, 0},
                                    {32, 0},
                                    {40, 1}}));
}

// The time that a program needs to start is no lateness of the robot.
TEST(Pace, LatenessBeginsWithTheFirstStep) {
  Pace pace(ms);
  EXPECT_FALSE(pace.take(5 * s));  // not started
  pace.start(5 * s);
  EXPECT_FALSE(pace.take(5 * s + ms - 1));
  EXPECT_TRUE(pace.take(5 * s + ms + 30 * us));
  EXPECT_FALSE(pace.take(5 * s + ms + 30 * us));
  EXPECT_EQ(pace.lateness().max_ns(), 30 * us);
  EXPECT_EQ(pace.overruns(), 0U);
}

// Of ten steps after a pause of 10 ms all but the last began more than a step late.
TEST(Pace, EveryLateStepIsAnOverrun) {
  Pace pace(ms);
  pace.start(0);
  int steps = 0;
  while (pace.take(10 * ms + 500 * us)) ++steps;
  EXPECT_EQ(steps, 10);
  EXPECT_EQ(pace.lateness().count(), 10U);
  EXPECT_EQ(pace.overruns(), 9U);
  EXPECT_EQ(pace.lateness().max_ns(), 9 * ms + 500 * us);
  EXPECT_EQ(pace.skipped_ns(), 0);
}

TEST(Pace, ALongPauseIsSkippedAndSaid) {
  Pace pace(ms);
  pace.start(0);
  EXPECT_TRUE(pace.take(ms + 2 * s));
  EXPECT_FALSE(pace.take(ms + 2 * s));
  EXPECT_EQ(pace.due_ns(), 2 * ms + 2 * s);
  EXPECT_EQ(pace.skipped_ns(), 2 * s);
  EXPECT_EQ(pace.overruns(), 1U);
}

SyncTiming synced(int count, std::int64_t period_ns, std::int64_t cycle_us) {
  SyncTiming timing;
  for (int k = 0; k < count; ++k) {
    timing.sync(s + k * period_ns, cycle_us);
    timing.answered(s + k * period_ns + (k % 100 ? 80 : 400) * us);
  }
  return timing;
}

TEST(SyncTiming, PeriodAndLatency) {
  SyncTiming timing = synced(1000, 2 * ms, 2000);
  timing.sync(s + 2000 * ms + 300 * us, 2000);
  EXPECT_NEAR(static_cast<double>(timing.period().median_ns()), 2 * ms, 2 * us);
  EXPECT_NEAR(static_cast<double>(timing.period().around_median().max_ns()), 300 * us, 2 * us);
  EXPECT_NEAR(static_cast<double>(timing.latency().median_ns()), 80 * us, 100);
  EXPECT_EQ(timing.latency().max_ns(), 400 * us);
  EXPECT_NEAR(*timing.time_scale(), 1, 1e-3);
}

TEST(SyncTiming, SlowMotionIsSaidWithBothFigures) {
  const auto slow = synced(100, 10 * ms, 2000).slow_motion();
  ASSERT_TRUE(slow);
  EXPECT_THAT(*slow, HasSubstr("every 10 ms"));
  EXPECT_THAT(*slow, HasSubstr("1006h says 2 ms"));
  EXPECT_THAT(*slow, HasSubstr("at 0.2 of real time"));
  for (const auto& [count, period_us, cycle_us] : {std::tuple{100, 2000, 2000},  // as agreed
                                                   std::tuple{100, 2200, 2000},  // within usual scatter
                                                   std::tuple{100, 1000, 2000},  // too fast is another matter
                                                   std::tuple{20, 10000, 2000},  // too few to judge
                                                   std::tuple{0, 1, 2000}})
    EXPECT_FALSE(synced(count, period_us * us, cycle_us).slow_motion()) << count << " " << period_us;
  EXPECT_TRUE(synced(6, 500 * ms, 2000).slow_motion());  // a few suffice where they take their time
  // One long pause, at a breakpoint of the master, is none.
  SyncTiming paused = synced(100, 2 * ms, 2000);
  paused.sync(100 * s, 2000);
  EXPECT_FALSE(paused.slow_motion());
}

}  // namespace
}  // namespace tribotwin::hil
