// Numbers as pages say them: no share is said to be all or nothing that is not, no zero is negative.
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include <tribotwin/render/page/in_words.hpp>

namespace tribotwin::render {
namespace {

TEST(Percent, HasTheDigitsThatMatter) {
  EXPECT_EQ(percent(0.042), "4.2 %");
  EXPECT_EQ(percent(0.314), "31 %");
  EXPECT_EQ(percent(1.27), "127 %");
  EXPECT_EQ(percent(std::numeric_limits<double>::quiet_NaN()), "–");
}

TEST(Percent, NothingAndAllAreOnlyThose) {
  EXPECT_EQ(percent(0), "0 %");
  EXPECT_EQ(percent(1e-9), "less than 0.1 %");
  EXPECT_EQ(percent(0.0011), "0.1 %");
  EXPECT_EQ(percent(0.994), "99 %");
  EXPECT_EQ(percent(0.9962), "99.6 %");
  EXPECT_EQ(percent(0.9996), "more than 99.9 %");
  EXPECT_EQ(percent(std::nextafter(1, 0)), "more than 99.9 %");
  EXPECT_EQ(percent(1), "100 %");
}

TEST(WithSigma, WhatRoundsToZeroHasNoMinus) {
  EXPECT_EQ(with_sigma(-3e-6, 1.2e-4), "0.00000 ± 0.00012");
  EXPECT_EQ(with_sigma(-3e-5, 1.2e-4), "-0.00003 ± 0.00012");
}

}  // namespace
}  // namespace tribotwin::render
