// What `identify` says of its numbers: which are none, what to record next, and whether their sigmas hold where the law
// does not follow the data.
#include <cmath>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/twin/identification/curves/fit.hpp>
#include <tribotwin/twin/identification/curves/misfit.hpp>
#include <tribotwin/twin/identification/identifiability.hpp>

namespace tribotwin::twin::identification {
namespace {

using testing::Contains, testing::HasSubstr, testing::IsEmpty, testing::IsSupersetOf, testing::Not;

friction::Law law_of(const char* name, std::vector<double> values) {
  friction::Law law{.info = friction::find_law(name), .validity = friction::Validity::extrapolate};
  return friction::with_parameters(law, values);
}

/// The cycloidal drive of the RH380-N study: Stribeck velocity 6 + 0.05 T rad/s.
friction::Law cycloidal() {
  return law_of("stribeck_T", {1.6, 0.02, 0, 2.4, 0.025, 1e-4, 6, 0.05, -2e-4, 1.4, 0.034, -8e-4, 6e-6});
}

/// Curves of a law, speeds evenly spaced by their logarithm. `arc_nm`: what the law does not know, over the speed.
struct Recording {
  double slowest, fastest;
  std::vector<double> temperatures_degC;
  double noise_nm = 0.02, arc_nm = 0;
  int speeds = 24;
};

Samples recorded(const friction::Law& law, const Recording& r, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> noise, reading(0, 0.1);
  std::uniform_real_distribution<double> phase(0, 2 * M_PI);
  const double phases[] = {phase(random), phase(random), phase(random)};
  Samples s;
  for (std::uint32_t c = 0; c < r.temperatures_degC.size(); ++c)
    for (int k = 0; k < r.speeds; ++k) {
      const double at = k / (r.speeds - 1.0), v = r.slowest * std::pow(r.fastest / r.slowest, at);
      const double T = r.temperatures_degC[c] + (r.temperatures_degC.size() > 1 ? reading(random) : 0);
      double arcs = 0;
      for (int i = 0; i < 3; ++i) arcs += r.arc_nm * std::sin(2 * M_PI * (1.3 + i) * at + phases[i]) / std::sqrt(1.5);
      s.speed.push_back(v), s.load.push_back(0), s.temperature_degC.push_back(T), s.curve.push_back(c);
      s.friction.push_back(friction::torque(law, v, 0, T) + arcs + r.noise_nm * noise(random));
    }
  return s;
}

std::string next_of(const Fit& fit, std::string_view name) {
  for (const auto& one : fit.lacking)
    if (one.parameter == name) return one.next;
  return {};
}

// Issue 21: "every parameter can be told" of vs0 = 2.0 +- 9.6. All speeds lie beyond the minimum of friction.
TEST(Judgement, SpeedsBeyondTheDipDoNotTellTheStribeckVelocityNorHowCoulombFrictionChangesWithHeat) {
  const std::vector<Recording> cases{{40, 150, {35}}, {40, 150, {38, 39, 41}}, {30, 150, {34, 36}, 0.02, 0.03}};
  for (const Recording& r : cases)
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      const friction::Law law = cycloidal();
      const auto f = fit(*law.info, recorded(law, r, seed));
      ASSERT_TRUE(f) << f.error().message;
      EXPECT_THAT(f->unidentifiable, IsSupersetOf({"vs0", "FcT"}))
          << r.temperatures_degC.size() << " temperatures, seed " << seed;
      EXPECT_THAT(next_of(*f, "vs0"), HasSubstr(fmt::format("speeds below {} rad/s", r.slowest)));
      EXPECT_THAT(next_of(*f, "FcT"), HasSubstr("temperature"));
    }
}

TEST(Judgement, ACampaignThatTellsEverythingLacksNothing) {
  const friction::Law law = cycloidal();  // FcTT is 0, and known to be
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const auto f = fit(*law.info, recorded(law, {0.5, 150, {20, 25, 30, 35, 40, 45, 50}, 0.002}, seed));
    ASSERT_TRUE(f) << f.error().message;
    EXPECT_THAT(f->unidentifiable, IsEmpty()) << lines_of(f->lacking).front();
    EXPECT_EQ(f->residual.arcs, 0) << seed;
  }
}

// Three waves over the decades of speed that no Stribeck law has, of 3 % of friction: sigmas of white residuals would
// hold a third of the truths only.
TEST(Judgement, SigmasCountTheArcsOfALawThatDoesNotFollow) {
  const friction::Law law = law_of("stribeck", {2.0, 1.0, 0.02, 6, 1.2});
  constexpr int repeats = 100;
  double inside = 0, named = 0;
  for (std::uint64_t seed = 1; seed <= repeats; ++seed) {
    const auto f = fit(*law.info, recorded(law, {0.3, 200, {30, 40, 50}, 0.005, 0.06, 30}, seed));
    ASSERT_TRUE(f) << f.error().message;
    named += f->residual.arcs > 0.3;
    for (std::size_t i = 0; i < 5; ++i)
      inside += f->parameters[i].low <= law.parameters[i] && law.parameters[i] <= f->parameters[i].high;
    if (seed > 1) continue;
    EXPECT_THAT(f->notes, Contains(HasSubstr("arcs along speed")));
    ASSERT_FALSE(f->lacking.empty());
  }
  fmt::print("{:.1f} % of intervals hold, arcs named in {:.0f} of {}\n", inside / 5 / repeats * 100, named, repeats);
  EXPECT_GE(named, 0.97 * repeats);
  EXPECT_GT(inside / 5 / repeats, 0.90);
  EXPECT_LT(inside / 5 / repeats, 0.99);
}

TEST(Judgement, NoiseHasNoArcs) {
  const friction::Law law = law_of("stribeck", {2.0, 1.0, 0.02, 6, 1.2});
  int alarms = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed)
    alarms += fit(*law.info, recorded(law, {0.3, 200, {30, 40, 50}, 0.05, 0, 30}, seed))->residual.arcs > 0;
  EXPECT_LE(alarms, 4);
}

TEST(Contains, FollowsFromTheTermsOfLaws) {
  const auto law = [](const char* name) -> const friction::LawInfo& { return *friction::find_law(name); };
  EXPECT_TRUE(contains(law("load"), law("stribeck")));
  EXPECT_TRUE(contains(law("extended"), law("stribeck")));
  EXPECT_TRUE(contains(law("stribeck_non_newtonian"), law("stribeck")));
  EXPECT_TRUE(contains(law("steady_state"), law("stribeck"))) << "v^beta contains v";
  EXPECT_FALSE(contains(law("stribeck"), law("load")));
  EXPECT_FALSE(contains(law("polynomial"), law("stribeck")));
  EXPECT_FALSE(contains(law("stribeck"), law("stribeck")));
}

TEST(Contains, AWiderLawIsWorseBeyondTwoStandardErrorsOnly) {
  const HeldOutErrors narrow{.rms = 1, .mean_squares = {1, 1.1, 0.9, 1, 1}};
  EXPECT_TRUE(worse({.rms = 1.1, .mean_squares = {1.2, 1.3, 1.15, 1.2, 1.25}}, narrow));
  EXPECT_FALSE(worse({.rms = 1.1, .mean_squares = {1, 1.1, 0.9, 1, 2}}, narrow)) << "of one curve";
  EXPECT_FALSE(worse({.rms = 0.9, .mean_squares = {0.8, 0.9, 0.7, 0.8, 0.8}}, narrow));
}

}  // namespace
}  // namespace tribotwin::twin::identification
