// Friction that differs between the directions: asymmetry and offset beside the parameters of every law.
#include <cmath>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/twin/identification/curves/direction.hpp>
#include <tribotwin/twin/identification/curves/fit.hpp>

namespace tribotwin::twin::identification {
namespace {

using testing::Contains, testing::HasSubstr, testing::IsEmpty, testing::Not;

struct Truth {
  double asymmetry, offset;
};

/// Speeds of both directions at some temperatures and loads, those of the reverse direction between the others.
Samples both_ways(const friction::Law& law, Truth truth, double noise, std::uint64_t seed, int conditions = 4) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> error(0, 1);
  Samples s;
  for (int c = 0; c < conditions; ++c)
    for (int k = 0; k < 40; ++k) {
      const double v = 0.5 * std::pow(400, k / 39.0), l = 0.2 * c, T = 40 + 12 * c, direction = k % 2 ? -1 : 1;
      const double level = friction::torque(law, v, l, T);
      s.speed.push_back(v);
      s.load.push_back(l);
      s.temperature_degC.push_back(T);
      s.friction.push_back(level * (1 + truth.asymmetry * direction) + truth.offset * direction +
                           noise * error(random));
      s.curve.push_back(static_cast<std::uint32_t>(c));
      s.direction.push_back(direction);
    }
  return s;
}

Samples without_direction(Samples s) {
  s.direction.clear();
  return s;
}

/// Laws with numbers at which their terms show between 0.5 and 200 rad/s.
std::vector<friction::Law> laws() {
  std::vector<friction::Law> all;
  const auto add = [&](const char* name, std::vector<std::pair<std::string, double>> values) {
    all.push_back(friction::make_law(name, values).value());
    all.back().validity = friction::Validity::extrapolate;
  };
  add("stribeck", {{"Fc", 0.034}, {"Fs", 0.03}, {"vs", 8}, {"alpha", 1.3}, {"Fv", 3.7e-4}});
  add("load", {{"Fc0", 0.03}, {"Fcl", 0.023}, {"Fs0", 0.02}, {"Fsl", 0.126}, {"vs", 9}, {"alpha", 1.36}, {"Fv", 3e-4}});
  add("steady_state", {{"Fc", 5}, {"Fs", 9}, {"Vs", 4}, {"alpha", 1.3}, {"Fv", 1}, {"beta", 0.5}});
  all.push_back(*friction::published_law("extended"));
  all.back().validity = friction::Validity::extrapolate;
  return all;
}

double mean_of(const std::vector<double>& x) {
  double sum = 0;
  for (const double v : x) sum += v;
  return sum / static_cast<double>(x.size());
}

const Estimate& named(const Fit& f, std::string_view name) {
  return *std::ranges::find(f.parameters, name, &Estimate::name);
}

// The case of an axis that no symmetric law explains.
TEST(Direction, EveryLawIsFoundWithItsAsymmetryAndOffset) {
  for (const friction::Law& law : laws()) {
    const double level = mean_of(both_ways(law, {0, 0}, 0, 1).friction), noise = 5e-3 * level;
    const Truth truth{0.05, 0.04 * level};
    const Samples s = both_ways(law, truth, noise, 3);
    const auto symmetric = fit(*law.info, without_direction(s)), f = fit(*law.info, s);
    ASSERT_TRUE(f && symmetric) << (f ? symmetric.error() : f.error()).message;
    EXPECT_GT(symmetric->residual.std, 0.07 * level) << law.info->name;
    EXPECT_NEAR(f->residual.std, noise, 0.15 * noise) << law.info->name;
    EXPECT_NEAR(f->asymmetry, truth.asymmetry, 3 * named(*f, "asymmetry").sigma) << law.info->name;
    EXPECT_NEAR(f->offset, truth.offset, 3 * named(*f, "offset").sigma) << law.info->name;
    EXPECT_LT(named(*f, "asymmetry").sigma, 0.02) << law.info->name;
    for (std::size_t i = 0; i < law.info->parameters.size(); ++i)
      if (f->parameters[i].status == Status::estimated)
        EXPECT_NEAR(f->parameters[i].value, law.parameters[i], 3.3 * f->parameters[i].sigma)
            << law.info->name << " " << f->parameters[i].name;
    EXPECT_THAT(f->notes, Contains(HasSubstr("differs between the directions")));
    ASSERT_EQ(f->covariance.rows(), static_cast<Eigen::Index>(f->parameters.size()));
  }
}

TEST(Direction, IntervalsCoverTheTruth) {
  const friction::Law law = laws()[0];
  const Truth truth{0.1, 0.006};
  int asymmetry = 0, offset = 0;
  constexpr int repeats = 100;
  for (int seed = 0; seed < repeats; ++seed) {
    const auto f = fit(*law.info, both_ways(law, truth, 1e-3, static_cast<std::uint64_t>(seed)), {.threads = 1});
    ASSERT_TRUE(f) << f.error().message;
    ASSERT_NE(f->asymmetry * f->offset, 0) << seed;
    const auto covers = [&](const char* name, double x) {
      return named(*f, name).low <= x && x <= named(*f, name).high;
    };
    asymmetry += covers("asymmetry", truth.asymmetry);
    offset += covers("offset", truth.offset);
  }
  fmt::print("covered: asymmetry {} %, offset {} %\n", asymmetry, offset);
  for (const int covered : {asymmetry, offset}) {
    EXPECT_GE(covered, 90);
    EXPECT_LE(covered, 99);
  }
}

// Fixing a number one sigma off its best value costs one variance: derivatives, search and covariance in one.
TEST(Direction, TheProfileOfTheCostHasTheWidthOfTheSigma) {
  const friction::Law law = laws()[0];
  Samples s = both_ways(law, {0.2, -0.004}, 1e-3, 5);
  for (std::size_t i = 0; i < s.size(); ++i) s.standard_error.push_back(i % 3 ? 1e-3 : 2e-3);
  const auto best = fit(*law.info, s);
  ASSERT_TRUE(best) << best.error().message;
  const double variance = best->cost / static_cast<double>(s.size() - best->estimated);
  for (const char* name : {"asymmetry", "offset"})
    for (const double sign : {1.0, -1.0}) {
      const auto beside =
          fit(*law.info, s, {.fixed = {{name, named(*best, name).value + sign * named(*best, name).sigma}}});
      ASSERT_TRUE(beside) << beside.error().message;
      EXPECT_NEAR(beside->cost - best->cost, variance, 0.02 * variance) << name;
      EXPECT_EQ(named(*beside, name).status, Status::fixed);
    }
}

TEST(Direction, OneDirectionOrNoDifferenceChangesNoBit) {
  const friction::Law law = laws()[0];
  int kept = 0;
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    const Samples s = both_ways(law, {0, 0}, 1e-3, seed, 2);
    Samples one_way = s;
    one_way.direction.assign(s.size(), -1);
    const auto plain = fit(*law.info, without_direction(s)), f = fit(*law.info, s), one = fit(*law.info, one_way);
    ASSERT_TRUE(plain && f && one);
    EXPECT_EQ(one->law.parameters, plain->law.parameters);
    EXPECT_EQ(one->notes, plain->notes);
    if (f->asymmetry != 0 || f->offset != 0) {
      ++kept;
      continue;
    }
    EXPECT_EQ(f->law.parameters, plain->law.parameters);
    EXPECT_EQ(f->parameters.size(), law.info->parameters.size());
    EXPECT_EQ(f->notes, plain->notes);
  }
  EXPECT_LE(kept, 9) << "of 40, at two tests of 5 %";
}

TEST(Direction, OnlyWhatTheDataTellIsKept) {
  const friction::Law law = laws()[0];
  const auto offset = fit(*law.info, both_ways(law, {0, 0.004}, 1e-3, 2));
  EXPECT_EQ(offset->asymmetry, 0);
  EXPECT_EQ(named(*offset, "asymmetry").status, Status::fixed);
  EXPECT_NEAR(offset->offset, 0.004, 3 * named(*offset, "offset").sigma);
  const auto asymmetry = fit(*law.info, both_ways(law, {-0.1, 0}, 1e-3, 2));
  EXPECT_EQ(asymmetry->offset, 0);
  EXPECT_NEAR(asymmetry->asymmetry, -0.1, 3 * named(*asymmetry, "asymmetry").sigma);

  // A level that never changes: both say the same.
  const friction::Law flat = friction::make_law("stribeck",
                                                std::vector<std::pair<std::string, double>>{
                                                    {"Fc", 0.05}, {"Fs", 0}, {"vs", 8}, {"alpha", 1.3}, {"Fv", 0}})
                                 .value();
  const auto either = fit(*flat.info, both_ways(flat, {0.1, 0}, 1e-3, 2), {.fixed = {{"Fs", 0}, {"Fv", 0}}});
  ASSERT_TRUE(either) << either.error().message;
  EXPECT_EQ(either->asymmetry * either->offset, 0);
  EXPECT_NE(either->asymmetry + either->offset, 0);
  EXPECT_THAT(either->notes, Contains(HasSubstr("would explain it as well")));

  const Samples known = both_ways(law, {0.1, 0.003}, 1e-3, 2);
  const auto none = fit(*law.info, known, {.fixed = {{"asymmetry", 0}, {"offset", 0}}});
  EXPECT_EQ(none->parameters.size(), law.info->parameters.size());
  EXPECT_THAT(fit(*law.info, known, {.fixed = {{"asymmetry", 1}}}).error().message, HasSubstr("-0.99 .. 0.99"));
}

TEST(Direction, LevelsWithTheDifferenceOfTheirDirectionsDoAsWell) {
  const friction::Law law = laws()[0];
  std::mt19937_64 random(4);
  std::normal_distribution<double> error(0, 5e-4);
  Samples s;
  for (int k = 0; k < 60; ++k) {
    const double v = 0.5 * std::pow(400, k / 59.0), level = friction::torque(law, v, 0, 40);
    s.speed.push_back(v), s.load.push_back(0), s.temperature_degC.push_back(40), s.curve.push_back(0);
    s.friction.push_back(level + error(random));
    s.difference.push_back(k == 7 ? std::nan("") : 0.08 * level - 0.003 + error(random));
  }
  const auto f = fit(*law.info, s);
  ASSERT_TRUE(f) << f.error().message;
  EXPECT_EQ(f->samples, 119);
  EXPECT_NEAR(f->asymmetry, 0.08, 3 * named(*f, "asymmetry").sigma);
  EXPECT_NEAR(f->offset, -0.003, 3 * named(*f, "offset").sigma);
  EXPECT_NEAR(f->residual.std, 5e-4 * std::sqrt(2), 1e-4);
  for (std::size_t i = 0; i < 5; ++i)
    EXPECT_NEAR(f->parameters[i].value, law.parameters[i], 3.3 * f->parameters[i].sigma) << i;
}

TEST(Direction, OutliersAndHeldOutCurvesAreTreatedAlike) {
  const friction::Law law = laws()[0];
  Samples s = both_ways(law, {0.1, 0.006}, 1e-3, 9);
  const double error = cross_validate(*law.info, without_direction(both_ways(law, {0, 0}, 1e-3, 9)), {}, 4)->rms;
  EXPECT_NEAR(cross_validate(*law.info, s, {}, 4)->rms, error, 0.03 * error);
  EXPECT_GT(cross_validate(*law.info, without_direction(s), {}, 4)->rms, 5e-3);
  for (std::size_t i = 0; i < s.size(); i += 21) s.friction[i] *= 3;
  const auto f = fit(*law.info, s, {.loss = Loss::cauchy});
  ASSERT_TRUE(f) << f.error().message;
  EXPECT_NEAR(f->asymmetry, 0.1, 3 * named(*f, "asymmetry").sigma);
  EXPECT_NEAR(f->offset, 0.006, 3 * named(*f, "offset").sigma);
  EXPECT_LT(named(*f, "offset").sigma, 1e-3);
}

}  // namespace
}  // namespace tribotwin::twin::identification
