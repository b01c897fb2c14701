#include <cmath>
#include <map>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/twin/identification/curves/basis.hpp>
#include <tribotwin/twin/identification/curves/fit.hpp>
#include <tribotwin/twin/identification/curves/separable.hpp>
#include <tribotwin/twin/numerics/least_squares.hpp>
#include <tribotwin/twin/numerics/solver_guard.hpp>

namespace tribotwin::twin::identification {
namespace {

using testing::Contains, testing::HasSubstr, testing::UnorderedElementsAre;

/// Bittencourt 2012's ranges: 12 speeds up to 280 rad/s, loads to 0.73, 38 .. 81.2 degC; friction of `law` with
/// Gaussian noise.
Samples campaign(const friction::Law& law, std::size_t curves, double noise, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> load(0, 0.73), temperature(38, 81.2);
  std::normal_distribution<double> error;
  Samples s;
  for (std::size_t c = 0; c < curves; ++c) {
    const double l = load(random), T = temperature(random);
    for (int k = 0; k < 12; ++k) {
      const double v = 1.5 * std::pow(280 / 1.5, k / 11.0);
      s.speed.push_back(v);
      s.load.push_back(l);
      s.temperature_degC.push_back(T);
      s.friction.push_back(friction::torque(law, v, l, T) + (noise > 0 ? noise * error(random) : 0));
      s.curve.push_back(static_cast<std::uint32_t>(c));
    }
  }
  return s;
}

const friction::LawInfo& extended() { return *friction::find_law("extended"); }
friction::Law published() { return *friction::published_law("extended"); }

std::vector<double> flat(const Fit& f) {
  std::vector<double> v;
  for (const auto& e : f.parameters) v.push_back(e.value);
  return v;
}

// Bittencourt 2012's ranges and noise, 5,808 samples. A mean over 1,000 seeds is known to 0.03 sigma, over 100 to 0.1
// only.
TEST(Identification, SigmasAreTheScatterAndNothingIsBiased) {
  const friction::Law truth = published();
  constexpr int seeds = 1000;
  std::vector<double> sum(12, 0), inside(12, 0);
  for (int seed = 1; seed <= seeds; ++seed) {
    const auto f = fit(extended(), campaign(truth, 484, 4.23e-3, static_cast<std::uint64_t>(seed)));
    ASSERT_TRUE(f) << f.error().message;
    ASSERT_TRUE(f->unidentifiable.empty());
    for (std::size_t i = 0; i < 12; ++i) {
      const auto& e = f->parameters[i];
      sum[i] += (e.value - truth.parameters[i]) / e.sigma;
      inside[i] += truth.parameters[i] >= e.low && truth.parameters[i] <= e.high;
    }
  }
  double covered = 0;
  for (std::size_t i = 0; i < 12; ++i) {
    EXPECT_LT(std::abs(sum[i] / seeds), 0.2) << extended().parameters[i].name << " is biased, in sigmas";
    covered += inside[i] / seeds / 12;
    EXPECT_GT(inside[i] / seeds, 0.93) << extended().parameters[i].name;
    EXPECT_LT(inside[i] / seeds, 0.97) << extended().parameters[i].name;
    fmt::print("{:6} bias {:6.3f} sigma, covered {:5.1f} %\n", extended().parameters[i].name, sum[i] / seeds,
               100 * inside[i] / seeds);
  }
  EXPECT_GT(covered, 0.94);
  EXPECT_LT(covered, 0.96);
}

/// The RH380-N study's range: 24 speeds up to 150 rad/s at each of some temperatures, read with 0.1 K of scatter;
/// RH380-N of mjcf/.
Samples heated(const friction::Law& law, std::initializer_list<double> temperatures, double noise, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> error, reading(0, 0.1);
  Samples s;
  for (const double mean : temperatures) {
    for (int k = 0; k < 24; ++k) {
      const double v = 0.5 * std::pow(300, k / 23.0), T = mean + (temperatures.size() > 1 ? reading(random) : 0);
      s.speed.push_back(v), s.load.push_back(0), s.temperature_degC.push_back(T);
      s.friction.push_back(friction::torque(law, v, 0, T) + noise * error(random));
      s.curve.push_back(s.curve.empty() ? 0 : s.curve.back() + (k == 0));
    }
  }
  return s;
}
friction::Law rh380n() {
  const auto& law = *friction::find_law("stribeck_T");
  friction::Law truth{.info = &law, .range = law.identified, .validity = friction::Validity::extrapolate};
  return friction::with_parameters(
      truth, std::vector<double>{1.6, 0.02, 0, 2.4, 0.025, 1e-4, 6, 0.05, -2e-4, 1.4, 0.034, -8e-4, 6e-6});
}

TEST(Identification, TemperaturePolynomialsOfTheCycloidalDrive) {
  const friction::Law truth = rh380n();
  constexpr int seeds = 300;
  std::vector<double> inside(13, 0);
  for (int seed = 1; seed <= seeds; ++seed) {
    const auto f =
        fit(*truth.info, heated(truth, {20, 25, 30, 35, 40, 45, 50}, 0.02, static_cast<std::uint64_t>(seed)));
    ASSERT_TRUE(f) << f.error().message;
    for (std::size_t i = 0; i < 13; ++i) {
      const auto& e = f->parameters[i];
      ASSERT_EQ(e.status, Status::estimated) << e.name << " seed " << seed;
      EXPECT_LT(std::abs(e.value - truth.parameters[i]), 4.5 * e.sigma) << e.name << " seed " << seed;
      inside[i] += truth.parameters[i] >= e.low && truth.parameters[i] <= e.high;
    }
  }
  for (std::size_t i = 0; i < 13; ++i) {
    fmt::print("{:5} covered {:5.1f} %\n", truth.info->parameters[i].name, 100 * inside[i] / seeds);
    EXPECT_GT(inside[i] / seeds, 0.91) << truth.info->parameters[i].name;
    EXPECT_LT(inside[i] / seeds, 0.985) << truth.info->parameters[i].name;
  }
}

TEST(Identification, FindsEveryLawFromNoiselessData) {
  const friction::Law paper1 = published();
  const std::map<std::string_view, std::vector<double>> truths{
      {"stribeck", {0.034, 0.046, 3.68e-4, 10.68, 1.93}},
      {"stribeck_non_newtonian", {0.034, 0.046, 3.68e-4, 10.68, 1.6, 2e-3, 0.5}},
      {"load", {0.03, 0.0234, 0.04, 0.126, 9.22, 1.36, 3.7e-4}},
      {"extended", {paper1.values().begin(), paper1.values().end()}},
      {"steady_state", {5.4, 7.8, 3, 1.3, 0.97, 0.6}},
      {"steady_state_extended", {4.9, 0.0155, 3.2, 7.8, 4.7, 2, 0.025, 1.3, 2.5, 32, 0.5, 0.0025}},
      {"polynomial", {20, 4, -1.5, 0.4, -0.006, 20}},
      {"stribeck_T", {1.6, 0.02, -1e-4, 2.4, 0.025, 1e-4, 6, 0.05, 2e-4, 1.4, 0.034, -5e-4, 3e-6}}};
  for (const auto& law : friction::laws()) {
    ASSERT_TRUE(truths.contains(law.name)) << "a law without a case: " << law.name;
    friction::Law truth;
    truth.info = &law;
    truth.validity = friction::Validity::extrapolate;
    truth = friction::with_parameters(truth, truths.at(law.name));
    Samples s = campaign(truth, 60, 0, 3);
    if (law.side == friction::Side::arm) {
      for (double& v : s.speed) v /= 160;
      for (std::size_t i = 0; i < s.size(); ++i)
        s.friction[i] = friction::torque(truth, s.speed[i], s.load[i], s.temperature_degC[i]);
    }
    const auto f = fit(law, s);
    ASSERT_TRUE(f) << law.name << ": " << f.error().message;
    for (std::size_t i = 0; i < law.parameters.size(); ++i)
      EXPECT_NEAR(f->parameters[i].value, truth.parameters[i], 2e-4 * std::abs(truth.parameters[i]) + 1e-9)
          << law.name << " " << law.parameters[i].name;
    EXPECT_GT(f->r_squared, 1 - 1e-9) << law.name;
  }
}

// Derivatives that the trust region and the sigmas rest on, against differences of the law itself.
TEST(Identification, DerivativesAreThoseOfTheLaw) {
  for (const auto& law : friction::laws()) {
    const Placement place(law);
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> unit(0.5, 1.5);
    std::vector<double> theta;
    for (const auto& p : law.parameters)
      theta.push_back((p.name.starts_with("vs0")                                            ? 30
                       : p.name == "vsTT"                                                   ? 2e-3
                       : p.name.starts_with("vs") && p.name.size() == 3 && p.name[2] == 'T' ? 0.2
                       : p.name.starts_with("v") || p.name.starts_with("V")                 ? 9
                       : p.name == "TV0"                                                    ? 20
                       : p.name.ends_with("T")                                              ? 1e-2
                       : p.name == "a"                                                      ? 3e-3
                       : p.name == "T0"                                                     ? 25
                                                                                            : 0.8) *
                      unit(random));
    const friction::GeneralLaw general_law = law.general_law(theta);
    Samples one;
    one.speed = {13}, one.load = {0.4}, one.temperature_degC = {47}, one.friction = {3};
    Eigen::VectorXd eta(static_cast<Eigen::Index>(place.linear_used.size()));
    for (std::size_t k = 0; k < place.linear_used.size(); ++k)
      eta(static_cast<Eigen::Index>(k)) = general_law.*linear_fields[place.linear_used[k]];
    const auto moments = accumulate(one, {}, place, general_law, 1);
    const auto at = moments.at(eta);
    const auto residual = [&](const friction::GeneralLaw& f) { return residuals(one, place, f, 1)[0]; };
    EXPECT_NEAR(at.rr, std::pow(residual(general_law), 2), 1e-9 * moments.yy) << law.name;
    for (std::size_t n = 0; n < place.nonlinear_used.size(); ++n) {
      const auto field = nonlinear_fields[place.nonlinear_used[n]];
      if (field == &friction::GeneralLaw::s_T0) continue;  // a convention, never free
      const double x = general_law.*field, h = 1e-5 * std::max(1e-3, std::abs(x));
      friction::GeneralLaw up = general_law, down = general_law;
      up.*field = x + h;
      down.*field = x - h;
      const double slope = -(residual(up) - residual(down)) / (2 * h);
      EXPECT_NEAR(at.Dr(static_cast<Eigen::Index>(n)), slope * residual(general_law),
                  1e-5 * std::abs(slope * residual(general_law)) + 1e-7)
          << law.name << " nonlinear " << n;
      EXPECT_NEAR(at.DD(static_cast<Eigen::Index>(n), static_cast<Eigen::Index>(n)), slope * slope,
                  1e-5 * slope * slope + 1e-9)
          << law.name << " nonlinear " << n;
    }
  }
}

// Far from the data a term or its square underflows, or powers overflow: the cost stays that of the other terms.
TEST(Identification, CostsAreFiniteWhereverTheSearchMayGo) {
  for (const auto& law : friction::laws()) {
    Samples s;
    for (int i = 0; i < 40; ++i)
      s.speed.push_back(2 + 7 * i), s.load.push_back(0.02 * i), s.temperature_degC.push_back(25 + i % 7 * 8),
          s.friction.push_back(1 + 0.1 * (i % 5));
    const Separable problem(law, s, {}, 1);
    std::mt19937_64 random(6);
    std::uniform_real_distribution<double> decade(-9, 6);
    for (int draw = 0; draw < 20000; ++draw) {
      Eigen::VectorXd at(static_cast<Eigen::Index>(law.parameters.size()));
      for (std::size_t i = 0; i < law.parameters.size(); ++i)
        at(static_cast<Eigen::Index>(i)) = (random() % 2 ? 1 : -1) * std::pow(10, decade(random));
      const Point point = problem.at(at);
      ASSERT_GT(point.cost, 0) << law.name << ": " << at.transpose();
      ASSERT_LE(point.cost, (1 + 1e-9) * point.moments.yy)
          << law.name << ": " << at.transpose() << " / " << point.values.transpose();
    }
  }
}

TEST(Identification, AllLinearAllNonlinearOrAllParametersMayBeFixed) {
  const auto s = campaign(published(), 40, 1e-3, 4);
  const auto& law = *friction::find_law("stribeck");
  for (const std::string_view known : {"F", "va", "Fva"}) {  // first letters
    const auto fixed = [&](std::string_view name) { return known.find(name.front()) != known.npos; };
    FitOptions options;
    for (const auto& [name, value] : {std::pair{"Fc", 0.03}, {"Fs", 0.05}, {"Fv", 4e-4}, {"vs", 11.0}, {"alpha", 1.4}})
      if (fixed(name)) options.fixed.emplace_back(name, value);
    const auto f = fit(law, s, options);
    ASSERT_TRUE(f) << f.error().message;
    EXPECT_EQ(f->estimated, law.parameters.size() - options.fixed.size());
    for (std::size_t i = 0; i < law.parameters.size(); ++i)
      EXPECT_EQ(f->parameters[i].status == Status::fixed, fixed(law.parameters[i].name));
  }
}

TEST(Identification, ThreadsDoNotChangeABit) {
  const auto s = campaign(published(), 4000, 4e-3, 2);
  const auto a = fit(extended(), s, {.threads = 1}), b = fit(extended(), s, {.threads = 3});
  EXPECT_EQ(flat(*a), flat(*b));
  EXPECT_EQ(a->cost, b->cost);
}

TEST(Identification, WeightsAreThoseOfTheStandardErrors) {
  // Half of the samples ten times as noisy: weighing makes sigmas smaller, and they are still right.
  const friction::Law truth = published();
  Samples s = campaign(truth, 300, 1e-3, 8);
  std::mt19937_64 random(4);
  std::normal_distribution<double> more(0, 1e-2);
  for (std::size_t i = 0; i < s.size(); ++i) {
    if (i % 2) s.friction[i] += more(random);
    s.standard_error.push_back(i % 2 ? std::hypot(1e-3, 1e-2) : 1e-3);
  }
  const auto weighted = fit(extended(), s), flat_weights = fit(extended(), s, {.weigh = false});
  for (std::size_t i = 0; i < 12; ++i) {
    EXPECT_LT(weighted->parameters[i].sigma, 0.35 * flat_weights->parameters[i].sigma);
    EXPECT_LT(std::abs(weighted->parameters[i].value - truth.parameters[i]), 4 * weighted->parameters[i].sigma);
  }
}

TEST(Identification, CoverageOfFixedParametersAndCorrelations) {
  const auto s = campaign(published(), 484, 4.23e-3, 7);
  const auto f = fit(extended(), s, {.fixed = {{"alpha", 1.36}}});
  ASSERT_TRUE(f);
  EXPECT_EQ(f->parameters[8].status, Status::fixed);
  EXPECT_EQ(f->parameters[8].value, 1.36);
  EXPECT_TRUE(std::isnan(f->parameters[8].sigma));
  for (std::size_t i = 0; i < 12; ++i)
    if (i != 8) {
      EXPECT_NEAR(f->correlation(i, i), 1, 1e-12);
    }
  EXPECT_LT(f->correlation(5, 6), -0.8);  // intercept and slope
  EXPECT_GT(f->condition_number, 3);
}

TEST(Identification, StagesGiveTheLoadTermsFromOneTemperature) {
  const friction::Law truth = published();
  Samples s;
  std::mt19937_64 random(6);
  std::normal_distribution<double> error(0, 2e-3);
  std::uint32_t curve = 0;
  const auto add = [&](double l, double T) {
    for (int k = 0; k < 12; ++k) {
      const double v = 1.5 * std::pow(280 / 1.5, k / 11.0);
      s.speed.push_back(v), s.load.push_back(l), s.temperature_degC.push_back(T), s.curve.push_back(curve);
      s.friction.push_back(friction::torque(truth, v, l, T) + error(random));
    }
    ++curve;
  };
  for (int i = 0; i < 50; ++i) add(0.73 * i / 49, 40);
  for (int i = 0; i < 50; ++i) add(0.02, 38 + 43.2 * i / 49), add(0.72, 38 + 43.2 * i / 49);
  const auto f = fit_staged(extended(), s, {.fixed = {{"alpha", 1.36}}});
  ASSERT_TRUE(f) << f.error().message;
  EXPECT_EQ(f->estimated, 11);
  for (std::size_t i = 0; i < 12; ++i)
    if (i != 8) {
      EXPECT_LT(std::abs(f->parameters[i].value - truth.parameters[i]), 3.5 * f->parameters[i].sigma)
          << f->parameters[i].name;
    }
  EXPECT_THAT(f->notes.front(), HasSubstr("600 samples at 40.0 degC and 50 loads"));
  EXPECT_THAT(fit_staged(*friction::find_law("stribeck"), s).error().message,
              HasSubstr("does not depend on both load and temperature"));
  const auto one_load = campaign(truth, 1, 0, 1);
  EXPECT_THAT(fit_staged(extended(), one_load).error().message, HasSubstr("three loads"));
}

TEST(Identification, SharedExponentOfUnloadedCurves) {
  const friction::Law truth = published();
  Samples s = campaign(truth, 488, 2e-3, 3);
  std::ranges::fill(s.load, 0.0);
  std::mt19937_64 random(3);
  std::normal_distribution<double> error(0, 2e-3);
  for (std::size_t i = 0; i < s.size(); ++i)
    s.friction[i] = friction::torque(truth, s.speed[i], 0, s.temperature_degC[i]) + error(random);
  const auto shared = fit_shared(*friction::find_law("stribeck"), s, "alpha");
  ASSERT_TRUE(shared) << shared.error().message;
  EXPECT_EQ(shared->curves, 488);
  EXPECT_NEAR(shared->value, 1.36, 0.02);
  EXPECT_LT(shared->sigma, 0.02);
  EXPECT_LT(std::abs(shared->value - 1.36), 3 * shared->sigma);
  EXPECT_TRUE(std::ranges::all_of(shared->profile, [](const auto& p) { return p.second >= -1e-9; }));
}

// What is not identifiable is reported, and the rest is right.
TEST(Degenerate, OneLoad) {
  Samples s = campaign(published(), 60, 0, 3);
  std::ranges::fill(s.load, 0.0);
  for (std::size_t i = 0; i < s.size(); ++i)
    s.friction[i] = friction::torque(published(), s.speed[i], 0, s.temperature_degC[i]);
  const auto f = fit(extended(), s);
  ASSERT_TRUE(f) << f.error().message;
  EXPECT_THAT(f->unidentifiable, UnorderedElementsAre("Fcl", "Fsl", "vsl"));
  EXPECT_NEAR(f->parameters[0].value, 3.11e-2, 1e-5);
  EXPECT_EQ(f->parameters[1].value, 0);
  EXPECT_EQ(f->law.range.load_max, 0);
}
TEST(Degenerate, OneTemperature) {
  Samples s = campaign(published(), 60, 1e-4, 3);
  for (std::size_t i = 0; i < s.size(); ++i)
    s.temperature_degC[i] = 50, s.friction[i] = friction::torque(published(), s.speed[i], s.load[i], 50);
  const auto f = fit(extended(), s);
  ASSERT_TRUE(f) << f.error().message;
  EXPECT_THAT(f->unidentifiable, UnorderedElementsAre("FsT", "vsT", "FvT", "TV0"));
  EXPECT_NEAR(f->parameters[2].value, -2.5e-2 + 1.6e-3 * 50, 1e-5) << "Fs at 50 degC";
  EXPECT_THAT(f->notes.front(), HasSubstr("all samples are at 50 degC"));
}
TEST(Degenerate, OneTemperatureAndTwoOfPolynomials) {
  const friction::Law truth = rh380n();
  const auto one = fit(*truth.info, heated(truth, {30}, 1e-3, 2)),
             two = fit(*truth.info, heated(truth, {20, 50}, 1e-3, 2));
  ASSERT_TRUE(one) << one.error().message;
  EXPECT_THAT(one->unidentifiable, UnorderedElementsAre("FcT", "FcTT", "FsT", "FsTT", "vsT", "vsTT", "FvT", "FvTT"));
  EXPECT_NEAR(one->parameters[0].value, 1.6 + 0.02 * 30, 4 * one->parameters[0].sigma) << "Fc at 30 degC";
  ASSERT_TRUE(two) << two.error().message;
  EXPECT_THAT(two->unidentifiable, UnorderedElementsAre("FcTT", "FsTT", "vsTT", "FvTT"));
  EXPECT_THAT(two->notes, Contains(HasSubstr("record a third temperature")));
  EXPECT_NEAR(two->parameters[1].value, 0.02, 4 * two->parameters[1].sigma) << "the chord of Fc, which is a line";
}
TEST(Degenerate, OneSpeed) {
  Samples s = campaign(published(), 60, 1e-4, 3);
  std::ranges::fill(s.speed, 20.0);
  const auto f = fit(*friction::find_law("stribeck"), s);
  ASSERT_TRUE(f) << f.error().message;
  EXPECT_THAT(f->unidentifiable, UnorderedElementsAre("Fs", "Fv", "vs", "alpha"));
}
TEST(Degenerate, TwoSpeeds) {
  Samples s = campaign(published(), 60, 1e-4, 3);
  for (std::size_t i = 0; i < s.size(); ++i) s.speed[i] = i % 2 ? 20 : 200;
  const auto f = fit(*friction::find_law("stribeck"), s);
  ASSERT_TRUE(f) << f.error().message;
  EXPECT_GE(f->unidentifiable.size(), 3);
}
TEST(Degenerate, NoFrictionAndTooFew) {
  Samples s = campaign(published(), 5, 0, 3);
  std::ranges::fill(s.friction, 0.0);
  EXPECT_THAT(fit(extended(), s).error().message, HasSubstr("friction is 0 in every sample"));
  Samples few = campaign(published(), 1, 0, 3);
  EXPECT_THAT(fit(extended(), few.subset(std::vector<std::size_t>{0, 1, 2})).error().message,
              HasSubstr("3 samples cannot determine"));
  EXPECT_THAT(fit(extended(), Samples{}).error().message, HasSubstr("no samples"));
}
TEST(Degenerate, OutliersAreSaidAndARobustLossForgetsThem) {
  const friction::Law truth = published();
  Samples s = campaign(truth, 300, 2e-3, 9);
  std::mt19937_64 random(9);
  std::uniform_real_distribution<double> anywhere(0, 1);
  for (std::size_t i = 0; i < s.size(); ++i)
    if (anywhere(random) < 0.2) s.friction[i] += 0.3 * anywhere(random);
  const auto plain = fit(extended(), s), robust = fit(extended(), s, {.loss = Loss::cauchy});
  ASSERT_TRUE(plain && robust);
  EXPECT_THAT(plain->notes, Contains(HasSubstr("outliers distort")));
  for (std::size_t i = 0; i < 12; ++i)
    EXPECT_LT(std::abs(robust->parameters[i].value - truth.parameters[i]), 5 * robust->parameters[i].sigma)
        << robust->parameters[i].name;
  EXPECT_GT(std::abs(plain->parameters[0].value - truth.parameters[0]), 5 * robust->parameters[0].sigma)
      << "or this test shows nothing";
}
TEST(Degenerate, ALawThatDoesNotFollowTheDataSaysSo) {
  const auto f = fit(*friction::find_law("stribeck"), campaign(published(), 100, 1e-4, 3));
  ASSERT_TRUE(f);
  EXPECT_THAT(f->notes, Contains(HasSubstr("does not follow these data")));
}
TEST(Degenerate, SteadyStateKeepsItsConstraint) {
  // Friction that rises from standstill on: Fs must not go below Fc.
  Samples s;
  for (int k = 0; k < 40; ++k) {
    const double v = 0.2 * std::pow(800, k / 39.0);
    s.speed.push_back(v), s.load.push_back(0), s.temperature_degC.push_back(30), s.curve.push_back(0);
    s.friction.push_back(5 + 0.5 * std::sqrt(v) - std::exp(-v / 3));
  }
  const auto f = fit(*friction::find_law("steady_state"), s);
  ASSERT_TRUE(f) << f.error().message;
  EXPECT_GE(f->parameters[1].value, f->parameters[0].value);
}

TEST(Degenerate, AFailedCheckOfTheSolverEndsTheProgramWithALine) {
  const auto fail = [] {
    exit_on_solver_failure("program");
    ceres::Problem().AddParameterBlock(nullptr, 2);
  };
  EXPECT_EXIT(fail(), testing::ExitedWithCode(1), "^program: the solver met numbers that it cannot use[^\n]*\n$");
}
TEST(Degenerate, TheSolverIsNotBegunWhereItWouldAbort) {
  const Eigen::VectorXd none, one = Eigen::VectorXd::Ones(1), bad = one * std::nan("");
  for (const Eigen::VectorXd& start : {none, bad}) {
    Eigen::VectorXd x = start;
    const auto residual = by_differences<ceres::CENTRAL>([](const Eigen::VectorXd& at) { return at; }, 1, 1);
    EXPECT_EQ(least_squares(*residual, x, one * 0, one * 2, {}), std::numeric_limits<double>::infinity());
  }
  Eigen::VectorXd x = one;
  const auto never = by_differences<ceres::CENTRAL>(
      [](const Eigen::VectorXd& at) { return Eigen::VectorXd(at * std::nan("")); }, 1, 1);
  EXPECT_EQ(least_squares(*never, x, one * 0, one * 2, {}), std::numeric_limits<double>::infinity());
}

}  // namespace
}  // namespace tribotwin::twin::identification
