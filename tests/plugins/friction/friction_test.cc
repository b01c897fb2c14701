#include <bit>
#include <random>

#include <gmock/gmock.h>

#include <tribotwin/plugins/friction/batch.hpp>
#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/plugins/friction/uncertainty.hpp>

namespace tribotwin::friction {
namespace {

using testing::HasSubstr;

Law law_of(std::string_view name, std::vector<std::pair<std::string, double>> values,
           Validity validity = Validity::clamp) {
  auto law = make_law(name, values);
  EXPECT_TRUE(law) << law.error().message;
  law->validity = validity;
  return *law;
}

Law steady_state_extended() {
  return law_of("steady_state_extended", {{"Fc0", 7.9},
                                          {"FcT", .027},
                                          {"Fcl", 5.4},
                                          {"Fs0", 13},
                                          {"Fsl", 7.8},
                                          {"Vs0", 2},
                                          {"VsT", .025},
                                          {"alpha", 1.3},
                                          {"FvT", 5.7},
                                          {"TV0", 32},
                                          {"beta0", .5},
                                          {"betaT", .0025}});
}

Law stribeck_T() {
  return law_of("stribeck_T", {{"Fc0", 60},
                               {"FcT", .8},
                               {"FcTT", .004},
                               {"Fs0", 90},
                               {"FsT", 1.2},
                               {"FsTT", .006},
                               {"vs0", 2},
                               {"vsT", .08},
                               {"vsTT", -4e-4},
                               {"delta", 1.4},
                               {"Fv0", 1.6},
                               {"FvT", -.04},
                               {"FvTT", 3.5e-4}});
}

/// One instance of every law, with the papers' numbers where there are any.
std::vector<Law> instances(Validity validity) {
  std::vector<Law> all{
      *published_law("stribeck"),
      law_of("stribeck_non_newtonian",
             {{"Fc", .034}, {"Fs", .046}, {"Fv", 3e-4}, {"vs", 10.7}, {"alpha", 1.93}, {"Fmu", 2e-4}, {"beta", .7}}),
      law_of(
          "load",
          {{"Fc0", .033}, {"Fcl", .0234}, {"Fs0", .04}, {"Fsl", .126}, {"vs", 9.22}, {"alpha", 1.36}, {"Fv", 3.7e-4}}),
      *published_law("extended"),
      law_of("steady_state", {{"Fc", 12}, {"Fs", 15}, {"Vs", 4}, {"alpha", 1.3}, {"Fv", .5}, {"beta", .6}}),
      steady_state_extended(),
      law_of("polynomial", {{"f1", 4}, {"f2", 3}, {"f3", -.4}, {"f4", .05}, {"a", -.012}, {"T0", 20}}),
      stribeck_T(),
  };
  EXPECT_TRUE(std::ranges::equal(
      all, laws(), {}, [](const Law& law) { return law.info->name; }, &LawInfo::name));
  for (Law& law : all) law.validity = validity;
  return all;
}

/// The formulas of the laws (plugins/friction/README.md), written out a second time.
double formula(const Law& law, double v, double l, double T) {
  const auto p = [&](const char* name) {
    for (std::size_t i = 0; i < law.info->parameters.size(); ++i)
      if (law.info->parameters[i].name == name) return law.parameters[i];
    throw std::logic_error(name);
  };
  const auto e = [&](double vs) { return std::exp(-std::pow(std::abs(v / vs), p("alpha"))); };
  const auto name = law.info->name;
  if (name == "stribeck") return p("Fc") + p("Fs") * e(p("vs")) + p("Fv") * v;
  if (name == "stribeck_non_newtonian")
    return p("Fc") + p("Fs") * e(p("vs")) + p("Fv") * v + p("Fmu") * std::pow(v, p("beta"));
  if (name == "load") return (p("Fc0") + p("Fcl") * l) + (p("Fs0") + p("Fsl") * l) * e(p("vs")) + p("Fv") * v;
  if (name == "extended")
    return (p("Fc0") + p("Fcl") * l) + p("Fsl") * l * e(p("vsl")) +
           (p("Fs0") + p("FsT") * T) * e(p("vs0") + p("vsT") * T) + (p("Fv0") + p("FvT") * std::exp(-T / p("TV0"))) * v;
  if (name == "steady_state") return p("Fc") + (p("Fs") - p("Fc")) * e(p("Vs")) + p("Fv") * std::pow(v, p("beta"));
  if (name == "steady_state_extended") {
    const double Fc = p("Fc0") + p("FcT") * T + p("Fcl") * l, Fs = p("Fs0") + p("Fsl") * l,
                 Vs = p("Vs0") + p("VsT") * T;
    return Fc + (Fs - Fc) * e(Vs) + p("FvT") * std::exp(-T / p("TV0")) * std::pow(v, p("beta0") + p("betaT") * T);
  }
  if (name == "stribeck_T") {
    const auto at = [&](const std::string& what) {
      return p((what + "0").c_str()) + p((what + "T").c_str()) * T + p((what + "TT").c_str()) * T * T;
    };
    return at("Fc") + (at("Fs") - at("Fc")) * std::exp(-std::pow(v / at("vs"), p("delta"))) + at("Fv") * v;
  }
  if (name == "polynomial")
    return (p("f1") + p("f2") * v + p("f3") * v * v + p("f4") * v * v * v) * (1 + p("a") * (T - p("T0")));
  throw std::logic_error("no formula for this law");
}

TEST(Laws, EqualTheirFormulasWithinTheirRange) {
  std::mt19937_64 random(1);
  for (const Law& law : instances(Validity::clamp)) {
    const auto& r = law.range;
    std::uniform_real_distribution<> v(1e-6,
                                       std::min(r.speed_max_rad_s, 6.0 * (law.info->side == Side::motor ? 100 : 1))),
        l(0, std::min(r.load_max, 1.0)),
        T(std::max(r.temperature_min_degC, 20.0), std::min(r.temperature_max_degC, 80.0));
    for (int i = 0; i < 20000; ++i) {
      const double vi = v(random), li = l(random), Ti = T(random), expected = formula(law, vi, li, Ti);
      ASSERT_NEAR(torque(law, vi, li, Ti), expected, 1e-12 * expected)
          << law.info->name << " " << vi << " " << li << " " << Ti;
    }
  }
}

TEST(Laws, AreOddFiniteAndDissipativeForAnyInputUnderEveryPolicy) {
  std::mt19937_64 random(2);
  std::uniform_real_distribution<> exponent(-12, 12), sign(-1, 1);
  std::uniform_int_distribution<> special(0, 99);
  const auto any = [&] {
    switch (special(random)) {
      case 0:
        return 0.0;
      case 1:
        return std::numeric_limits<double>::infinity();
      case 2:
        return std::numeric_limits<double>::quiet_NaN();
      case 3:
        return std::numeric_limits<double>::max();
      case 4:
        return std::numeric_limits<double>::denorm_min();
      default:
        return std::copysign(std::pow(10, exponent(random)), sign(random));
    }
  };
  std::uniform_real_distribution<> usual_T(-60, 200);
  for (const Validity validity : {Validity::clamp, Validity::extrapolate, Validity::error})
    for (const Law& law : instances(validity))
      for (int i = 0; i < 60000; ++i) {  // 3 policies x 8 laws: 1.44e6 inputs
        const double v = any(), l = any(), T = i % 2 ? any() : usual_T(random);
        const double forward = torque(law, v, l, T), backward = torque(law, -v, l, T);
        ASSERT_TRUE(std::isfinite(forward)) << law.info->name << " " << v << " " << l << " " << T;
        ASSERT_EQ(forward, -backward) << law.info->name << " " << v << " " << l << " " << T;
        if (v > 0) ASSERT_GE(forward, 0) << law.info->name << " " << v << " " << l << " " << T;
        const Level at = level(law, at_temperature(law, T), v, l);
        ASSERT_GE(at.weakening, 0);
        ASSERT_GE(at.total(), 0);
      }
}

TEST(Laws, PlaceTheirParametersInTheFamilyAffinely) {
  using Fields = std::array<double, sizeof(GeneralLaw) / sizeof(double)>;
  std::mt19937_64 random(4);
  std::uniform_real_distribution<> value(-10, 10);
  for (const LawInfo& law : laws())
    for (int k = 0; k < 100; ++k) {
      std::array<double, max_parameters> a{}, b{}, sum{};
      for (std::size_t i = 0; i < law.parameters.size(); ++i)
        a[i] = value(random), b[i] = value(random), sum[i] = a[i] + b[i];
      const auto at = [&](const auto& p) {
        return std::bit_cast<Fields>(law.general_law({p.data(), law.parameters.size()}));
      };
      const Fields of_a = at(a), of_b = at(b), of_0 = at(decltype(a){}), of_sum = at(sum);
      for (std::size_t i = 0; i < of_a.size(); ++i)
        ASSERT_NEAR(of_a[i] + of_b[i] - of_0[i], of_sum[i], 1e-13) << law.name << " field " << i;
    }
}

TEST(Laws, ColdExtendedLawIsHeldAtTheEdgeAndCounted) {
  const Law law = *published_law("extended");
  for (const double v : {0.5, 10.0, 200.0}) {
    EXPECT_EQ(torque(law, v, 0.3, 20), torque(law, v, 0.3, 38));
    EXPECT_TRUE(level(law, at_temperature(law, 20), v, 0.3).outside);
    EXPECT_FALSE(level(law, at_temperature(law, 38), v, 0.3).outside);
  }
  EXPECT_TRUE(level(law, at_temperature(law, 50), 281, 0.3).outside);
  EXPECT_TRUE(level(law, at_temperature(law, 50), 100, -0.74).outside);
}

TEST(Laws, PublishedChecksOfTheExtendedLaw) {
  // papers/README.md: at 34 degC the Stribeck velocity is 8.5 rad/s and the viscous slope 3.86e-4.
  Law law = *published_law("extended");
  law.validity = Validity::extrapolate;
  const auto at = at_temperature(law, 34).coefficients;
  EXPECT_NEAR(std::pow(at.vs_pow, -1 / 1.36), 8.5, 0.02);
  EXPECT_NEAR(at.amplitude[formula::linear][0], 3.86e-4, 1e-6);
}

TEST(Laws, ExtendedSteadyStateIsPaperTwosLawWithMovingCoefficients) {
  const Law law = steady_state_extended();
  for (const double T : {20.0, 38.0, 60.0})
    for (const double l : {0.0, 0.4, 1.0}) {
      const Law there = law_of("steady_state", {{"Fc", 7.9 + .027 * T + 5.4 * l},
                                                {"Fs", 13 + 7.8 * l},
                                                {"Vs", 2 + .025 * T},
                                                {"alpha", 1.3},
                                                {"Fv", 5.7 * std::exp(-T / 32)},
                                                {"beta", .5 + .0025 * T}});
      for (const double v : {0.1, 2.0, 9.0, 174.6})
        EXPECT_NEAR(torque(law, v, -l, T), torque(there, v, 0, 0), 1e-12 * torque(there, v, 0, 0));
    }
}

TEST(Laws, ViscousExponentIsHeldWhereATemperatureWouldMakeItNegativeOrHuge) {
  const Law law = law_of("steady_state_extended",
                         {{"Fc0", 1},
                          {"FcT", 0},
                          {"Fcl", 0},
                          {"Fs0", 1},
                          {"Fsl", 0},
                          {"Vs0", 1},
                          {"VsT", 0},
                          {"alpha", 1.3},
                          {"FvT", 1},
                          {"TV0", 1000},
                          {"beta0", .5},
                          {"betaT", .05}},
                         Validity::extrapolate);
  for (const auto& [T, beta] :
       {std::pair{-200.0, exponent_min}, {-20.0, exponent_min}, {50.0, 3.0}, {1000.0, exponent_max}}) {
    EXPECT_EQ(at_temperature(law, T).coefficients.beta, beta);
    const double expected = 1 + std::exp(-T / 1000) * std::pow(1e6, beta);
    EXPECT_NEAR(torque(law, 1e9, 0, T), expected, 1e-12 * expected);
    for (const VectorWidth width : {VectorWidth::baseline, best_vector_width()})
      EXPECT_NEAR(torque(law, Eigen::ArrayXd::Constant(5, 1e9), Eigen::ArrayXd::Zero(5), Eigen::ArrayXd::Constant(5, T),
                         width)[4],
                  expected, 1e-12 * expected);
  }
}

TEST(Laws, MistakesAreNamed) {
  EXPECT_THAT(make_law("extendet", {}).error().message, HasSubstr("did you mean 'extended'"));
  using Values = std::vector<std::pair<std::string, double>>;
  EXPECT_THAT(make_law("stribeck", Values{{"Fcc", 1}}).error().message, HasSubstr("did you mean 'Fc'"));
  EXPECT_THAT(make_law("stribeck", Values{{"Fc", .1}}).error().message, HasSubstr("lacks its parameter 'Fs'"));
  EXPECT_THAT(make_law("stribeck", Values{{"vs", 0}}).error().message, HasSubstr("must be within"));
  EXPECT_THAT(make_law("stribeck", Values{{"vs", std::nan("")}}).error().message, HasSubstr("must be within"));
  EXPECT_THAT(make_law("stribeck", Values{{"vs", 1}, {"vs", 1}}).error().message, HasSubstr("twice"));
  EXPECT_THAT(make_law("steady_state", Values{{"Fc", 2}, {"Fs", 1}, {"Vs", 1}, {"alpha", 1}, {"Fv", 0}, {"beta", 1}})
                  .error()
                  .message,
              HasSubstr("Fs is the standstill level"));
  // Each breaks one condition, at one corner of the range.
  const auto moved = [](const char* name, double value) {
    Values values{{"Fc0", 8},   {"FcT", .03},   {"Fcl", 5}, {"Fs0", 13}, {"Fsl", 6},    {"Vs0", 2},
                  {"VsT", .02}, {"alpha", 1.3}, {"FvT", 5}, {"TV0", 30}, {"beta0", .5}, {"betaT", .002}};
    for (auto& [key, now] : values)
      if (key == name) now = value;
    const auto law = make_law("steady_state_extended", values);
    return law ? std::string("accepted") : law.error().message;
  };
  EXPECT_EQ(moved("FcT", .0833), "accepted");
  EXPECT_THAT(moved("FcT", .0834), HasSubstr("Fs0 + Fsl l is the standstill level"));
  EXPECT_EQ(moved("Fsl", 1.81), "accepted");
  EXPECT_THAT(moved("Fsl", 1.79), HasSubstr("Fs0 + Fsl l is the standstill level"));
  EXPECT_EQ(moved("FcT", -.05), "accepted");
  EXPECT_THAT(moved("FcT", -.3), HasSubstr("Coulomb friction and must not be below 0"));
  EXPECT_EQ(moved("VsT", -.033), "accepted");
  EXPECT_THAT(moved("VsT", -.034), HasSubstr("Vs0 + VsT T is the Stribeck velocity"));
  EXPECT_EQ(moved("Vs0", -.39), "accepted");
  EXPECT_THAT(moved("Vs0", -.41), HasSubstr("Vs0 + VsT T is the Stribeck velocity"));
  EXPECT_THAT(moved("betaT", -.0084), HasSubstr("beta0 + betaT T is the viscous exponent"));
  EXPECT_THAT(moved("betaT", .08), HasSubstr("beta0 + betaT T is the viscous exponent"));
}

TEST(Laws, PolynomialsInTemperatureAreCheckedBetweenTheEndsOfTheRangeToo) {
  std::vector<std::pair<std::string, double>> values;
  const Law good = stribeck_T();
  for (std::size_t i = 0; i < good.values().size(); ++i)
    values.emplace_back(good.info->parameters[i].name, good.values()[i]);
  const auto moved = [&](std::initializer_list<std::pair<const char*, double>> changes) {
    auto all = values;
    for (const auto& [name, value] : changes)
      std::ranges::find(all, name, [](const auto& v) { return v.first; })->second = value;
    const auto law = make_law("stribeck_T", all);
    return law ? std::string("accepted") : law.error().message;
  };
  EXPECT_EQ(moved({}), "accepted");
  // (T - 35)^2 - 0.01: fine at 20 and 50 degC, below 0 at 35.
  EXPECT_THAT(moved({{"Fv0", 1224.99}, {"FvT", -70}, {"FvTT", 1}}), HasSubstr("viscous slope and must not be below 0"));
  // Four times as steep.
  EXPECT_THAT(moved({{"Fv0", 4899.96}, {"FvT", -280}, {"FvTT", 4}}), HasSubstr("viscous slope"));
  EXPECT_THAT(moved({{"vs0", 0}, {"vsT", 0}, {"vsTT", 0}}), HasSubstr("Stribeck velocity"));
  EXPECT_THAT(moved({{"FsTT", -.1}}), HasSubstr("standstill level"));
  EXPECT_THAT(moved({{"Fc0", -100}}), HasSubstr("Coulomb friction"));
}

TEST(Laws, DependOnLoadAndTemperatureAsTheySay) {
  for (const Law& law : instances(Validity::extrapolate)) {
    const auto at = [&](double load_norm, double temperature_degC) {
      return torque(law, 30, load_norm, temperature_degC);
    };
    EXPECT_EQ(at(0.1, 40) != at(0.6, 40), law.info->load_dependent) << law.info->name;
    EXPECT_EQ(at(0.1, 25) != at(0.1, 45), law.info->temperature_dependent) << law.info->name;
  }
}

TEST(Laws, AreScaledInBothPartsAndInSpeed) {
  for (const Law& law : instances(Validity::extrapolate)) {
    const Law changed = scaled(law, 1.5, 2, 0.5), faster = scaled(law, 1, 2, 1);
    for (const double v : {0.5, 5.0, 40.0}) {
      const auto level_of = [&](const Law& one, double speed_rad_s) {
        return level(one, at_temperature(one, 40), speed_rad_s, 0.4);
      };
      const Level usual = level_of(law, v), other = level_of(changed, v);
      const double weakening = level_of(faster, v).weakening;
      EXPECT_NEAR(level_of(faster, 2 * v).weakening, usual.weakening, 1e-12 * usual.weakening) << law.info->name;
      EXPECT_NEAR(other.weakening, 1.5 * weakening, 1e-12 * other.weakening) << law.info->name << " " << v;
      EXPECT_NEAR(other.strengthening, 0.5 * usual.strengthening, 1e-12 * other.total()) << law.info->name << " " << v;
    }
  }
}

TEST(Uncertainty, OfALinearLawIsItsClosedForm) {
  // Far above the Stribeck velocity friction is Fc + Fv v; at rest it is Fc + Fs.
  const Law law = law_of("stribeck", {{"Fc", .034}, {"Fs", .046}, {"Fv", 3.68e-4}, {"vs", 1}, {"alpha", 2}});
  const double Fc = 4e-8, Fs = 9e-8, Fv = 1e-12, both = -1.5e-10;
  std::vector covariance(5, std::vector<double>(5));
  for (std::size_t i = 0; i < 5; ++i) {
    const std::string_view name = law.info->parameters[i].name;
    for (std::size_t k = 0; k < 5; ++k) {
      const std::string_view other = law.info->parameters[k].name;
      if ((name == "Fc" && other == "Fv") || (name == "Fv" && other == "Fc")) covariance[i][k] = both;
    }
    covariance[i][i] = name == "Fc" ? Fc : name == "Fs" ? Fs : name == "Fv" ? Fv : 0;
  }
  const Uncertainty u = make_uncertainty(law, covariance, 2);
  for (const double v : {50., 120., 250.}) {
    const double expected = 2 * std::sqrt(Fc + 2 * v * both + v * v * Fv);
    EXPECT_NEAR(half_width(law, u, v, 0, 20), expected, 1e-8 * expected);
    EXPECT_EQ(half_width(law, u, -v, 0, 20), half_width(law, u, v, 0, 20));
  }
  EXPECT_NEAR(half_width(law, u, 0, 0, 20), 2 * std::sqrt(Fc + Fs), 1e-8 * std::sqrt(Fc + Fs));
}

TEST(Batch, EqualsTheScalarLawInsideAndOutsideTheRange) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<> v(-400, 400), l(-1.5, 1.5), T(-20, 120);
  for (const Validity validity : {Validity::clamp, Validity::extrapolate})
    for (const Law& law : instances(validity))
      for (const int n : {1, 7, 4099}) {
        Eigen::ArrayXd vs(n), ls(n), Ts(n);
        for (int i = 0; i < n; ++i) vs[i] = v(random), ls[i] = l(random), Ts[i] = T(random);
        vs[0] = 0;
        if (n > 7)
          vs[1] = std::nan(""), ls[2] = std::nan(""), Ts[3] = std::nan(""), vs[4] = 1e300, Ts[5] = -1e300,
          vs[6] = 1e-300;
        for (const VectorWidth width : {VectorWidth::baseline, best_vector_width()}) {
          const Eigen::ArrayXd batch = torque(law, vs, ls, Ts, width);
          for (int i = 0; i < n; ++i) {
            const double scalar = torque(law, vs[i], ls[i], Ts[i]);
            ASSERT_NEAR(batch[i], scalar, 1e-12 * std::abs(scalar))
                << law.info->name << " " << vs[i] << " " << ls[i] << " " << Ts[i];
          }
        }
      }
}

}  // namespace
}  // namespace tribotwin::friction
