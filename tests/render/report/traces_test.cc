// Curves of few points: each sample counts once.
#include <algorithm>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include <tribotwin/render/report/record/traces.hpp>

namespace tribotwin::render {
namespace {

std::vector<double> every(double step_s, std::size_t count) {
  std::vector<double> time_s(count);
  for (std::size_t i = 0; i < count; ++i) time_s[i] = 3 + step_s * static_cast<double>(i);
  return time_s;
}

TEST(RmsTrace, TheLastSampleIsNoWindowOfItsOwn) {
  const auto time_s = every(0.001, 10001);
  std::vector<double> values(time_s.size(), 2);
  values.back() = 40;  // of 51 samples of the last window
  const Trace t = rms_trace("", time_s, values, 10.0 / 200);
  ASSERT_EQ(t.values.size(), 200U);
  EXPECT_DOUBLE_EQ(t.values.front(), 2);
  EXPECT_LT(t.values.back(), 10);
  EXPECT_NEAR(t.time_s.front(), 3.025, 1e-9);
  EXPECT_NEAR(t.time_s.back(), 12.975, 1e-9);
}

TEST(RmsTrace, EachSampleIsInOneWindowWhateverTheirNumber) {
  for (const std::size_t count : {2U, 3U, 7U, 199U, 201U, 1000U, 4999U}) {
    const auto time_s = every(0.004, count);
    for (std::size_t one = 0; one < count; one += 1 + count / 50) {
      std::vector<double> values(count, 0);
      values[one] = 5;
      const Trace t = rms_trace("", time_s, values, (time_s.back() - time_s.front()) / 40);
      EXPECT_EQ(std::ranges::count_if(t.values, [](double v) { return v > 0; }), 1) << count << " " << one;
      EXPECT_LE(t.values.size(), 40U);
    }
  }
}

TEST(RmsTrace, WindowsAreEquallyLong) {
  const Trace t = rms_trace("", every(0.01, 1000), std::vector<double>(1000, 1), 0.7);
  ASSERT_EQ(t.time_s.size(), 14U);  // of 9.99 s
  for (std::size_t i = 1; i < t.time_s.size(); ++i) EXPECT_NEAR(t.time_s[i] - t.time_s[i - 1], 9.99 / 14, 1e-9);
}

TEST(RmsTrace, NanIsLeftOutAndGapsAreSkipped) {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<double> time_s{0, 1, 2, 3, 8, 9, 10}, values{3, nan, nan, nan, 4, -4, nan};
  const Trace t = rms_trace("", time_s, values, 2);
  ASSERT_EQ(t.time_s.size(), 3U);
  EXPECT_EQ(t.time_s, (std::vector<double>{1, 3, 9}));
  EXPECT_DOUBLE_EQ(t.values[0], 3);
  EXPECT_TRUE(std::isnan(t.values[1]));
  EXPECT_DOUBLE_EQ(t.values[2], 4);
}

TEST(RmsTrace, OneSampleAndNone) {
  EXPECT_EQ(rms_trace("", std::vector<double>{7}, std::vector<double>{-2}, 1).values, std::vector<double>{2});
  EXPECT_TRUE(rms_trace("", {}, {}, 1).values.empty());
}

}  // namespace
}  // namespace tribotwin::render
