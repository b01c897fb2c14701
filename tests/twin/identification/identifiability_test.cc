#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tribotwin/twin/identification/identifiability.hpp>

namespace tribotwin::twin::identification {
namespace {

using ::testing::ElementsAre, ::testing::HasSubstr, ::testing::IsEmpty;

Estimate of(std::string name, double value, double sigma, Status status = Status::estimated) {
  const double half = 2 * sigma;
  return {.name = std::move(name),
          .unit = "s",
          .value = value,
          .sigma = sigma,
          .low = value - half,
          .high = value + half,
          .status = status};
}

/// What the rule says of the first parameter.
struct Case {
  const char* what;
  std::vector<Estimate> parameters;
  Evidence evidence;  ///< parameters aside
  Lack lack;
  const char* says;
  bool withheld = true;
};

Eigen::MatrixXd covariance(double a, double b, double correlation) {
  return Eigen::Matrix2d{{a * a, correlation * a * b}, {correlation * a * b, b * b}};
}

TEST(Identifiability, EachLackIsNamedWithWhatToRecord) {
  const double nan = std::nan("");
  const std::vector<Case> cases = {
      {"held", {of("c1", 0, nan, Status::held)}, {}, Lack::no_effect, "no effect"},
      {"at a bound", {of("t2", 9e4, nan, Status::at_bound)}, {}, Lack::at_bound, "9e+04 s is the end"},
      {"no sigma", {of("c1", 2, nan)}, {}, Lack::wide_interval, "no finite interval"},
      {"issue 21's identify case", {of("vs0", 2.0, 9.6)}, {}, Lack::wide_interval, "-17.2 .. 21.2 s"},
      {"an offset near 0 by its scale", {of("T_amb", 0, 2)}, {.scale = {5}}, Lack::wide_interval, "wider than 5 s"},
      {"correlated",
       {of("a", 1, 0.1), of("b", 1, 0.1)},
       {.covariance = covariance(0.1, 0.1, -0.995)},
       Lack::correlated,
       "with b is -0.995"},
      {"7 minutes for t2",
       {of("c2", 4, 0.01), of("t2", 1400, 10)},
       {.time_constants = {{"t2", {"c2"}}}, .recorded_s = 420},
       Lack::short_record,
       "420 s, is too short for t2 of up to 0.39 h"},
      {"no whole cycle", {of("c1", 4, 0.01)}, {.cycles = 1, .cycles_needed = 2}, Lack::no_whole_cycle, "1 whole"},
      {"arcs", {of("c1", 4, 0.01)}, {.common = 0.9, .explained = 0.98}, Lack::structured, "arcs along time", false},
      {"arcs and nothing else",
       {of("c1", 4, 0.01)},
       {.common = 0.9, .explained = 0.2, .along = "speed"},
       Lack::structured,
       "explains 20 %"}};
  for (Case c : cases) {
    SCOPED_TRACE(c.what);
    c.evidence.parameters = c.parameters;
    const auto all = lacking(c.evidence);
    ASSERT_FALSE(all.empty());
    EXPECT_EQ(all[0].parameter, c.parameters[0].name);
    EXPECT_EQ(all[0].lack, c.lack);
    EXPECT_THAT(all[0].reason, HasSubstr(c.says));
    EXPECT_FALSE(all[0].next.empty());
    EXPECT_EQ(all[0].withheld, c.withheld);
    EXPECT_EQ(withheld(all).size(), all.size() * c.withheld);
  }
}

TEST(Identifiability, WhatTheDataDetermineLacksNothing) {
  const std::vector<Estimate> good{of("a", 1, 0.02), of("t", 100, 5), of("known", 3, std::nan(""), Status::fixed),
                                   of("T_amb", 0, 0.5)};
  Evidence evidence{.parameters = good,
                    .covariance = Eigen::MatrixXd::Constant(4, 4, std::nan("")),
                    .scale = {0, 0, 0, 20},
                    .time_constants = {{"t", {"a"}}},
                    .recorded_s = 120,
                    .cycles = 2,
                    .cycles_needed = 2,
                    .common = 0.4,
                    .explained = 0.3};
  // A correlation over 0.99 does no harm to numbers known to a tenth of their value.
  evidence.covariance.topLeftCorner(2, 2) = covariance(0.02, 5, 0.999);
  evidence.parameters = std::span(good).first(1);
  EXPECT_THAT(lacking(evidence), IsEmpty());
  evidence.parameters = good;
  EXPECT_THAT(withheld(lacking(evidence)), ElementsAre("t"));  // 0.2 of its value wide
}

TEST(Identifiability, TheCommandsOwnAdviceComesFirst) {
  const std::vector<Estimate> parameters{of("vs0", 2, 9.6), of("Fc", 0, std::nan(""), Status::held)};
  const auto all = lacking({.parameters = parameters}, [](const Estimate& e, Lack lack) {
    return e.name == "vs0" && lack == Lack::wide_interval ? std::string("record speeds below 10 rad/s") : "";
  });
  ASSERT_EQ(all.size(), 2);
  EXPECT_EQ(sentence(all[0]),
            "vs0 is not identifiable: its 95 % interval, -17.2 .. 21.2 s, is wider than its value; record speeds below "
            "10 rad/s");
  EXPECT_FALSE(all[1].next.empty());
}

}  // namespace
}  // namespace tribotwin::twin::identification
