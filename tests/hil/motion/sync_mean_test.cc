#include <gtest/gtest.h>

#include <tribotwin/hil/motion/sync_mean.hpp>

namespace tribotwin::hil {
namespace {

constexpr double step_s = 0.001;

void add(SyncMean& mean, double value, int steps) {
  for (int k = 0; k < steps; ++k) mean.add(value, step_s);
}

// A ripple of the set points' period has its mean at every SYNC, wherever the SYNC falls into it.
TEST(SyncMean, IsThatOfTheInterval) {
  for (int phase = 0; phase < 10; ++phase) {
    SCOPED_TRACE(phase);
    SyncMean mean;
    mean.sync();
    for (int k = 0; k < 50; ++k) {
      mean.add((k + phase) % 10 == 0 ? 100 : 0, step_s);
      if (k % 10 == 9) EXPECT_NEAR(mean.value(), 10, 1e-12), mean.sync();
    }
  }
}

// A cycle of one step is that step, to the last bit: lockstep at the step of the physics.
TEST(SyncMean, OfOneStepIsItsValue) {
  SyncMean mean;
  for (const double value : {0.1 + 0.2, -1e9 / 3, 1e-300}) {
    mean.add(value, step_s);
    EXPECT_EQ(mean.value(), value);
    mean.sync();
    EXPECT_EQ(mean.value(), value);  // also while nothing has moved since
  }
}

TEST(SyncMean, WithoutSyncIsTheLastStep) {
  SyncMean mean;
  add(mean, 5, 3);
  mean.add(7, step_s);
  EXPECT_EQ(mean.value(), 7);
  mean.sync();
  add(mean, 1, 10);
  mean.sync();
  add(mean, 9, 50);
  mean.add(0, step_s);
  EXPECT_GT(mean.value(), 8);  // the next SYNC may still come
  add(mean, 9, 50);
  mean.add(0, step_s);
  EXPECT_EQ(mean.value(), 0);  // 0.1 s: the master is gone
  mean.sync();
  add(mean, 2, 4);
  EXPECT_NEAR(mean.value(), 2, 1e-12);
}

// A master of 200 ms is none that is gone.
TEST(SyncMean, OfALongCycle) {
  SyncMean mean;
  for (int k = 0; k < 4; ++k) {
    mean.sync();
    add(mean, 1, 100);
    add(mean, 3, 100);
  }
  EXPECT_NEAR(mean.value(), 2, 1e-12);
}

}  // namespace
}  // namespace tribotwin::hil
