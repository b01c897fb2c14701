#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <tribotwin/tests/twin/identification/thermal/simulated_day.hpp>
#include <tribotwin/twin/identification/thermal/thermal_band.hpp>
#include <tribotwin/twin/identification/thermal/thermal_chain_file.hpp>
#include <tribotwin/twin/identification/thermal/thermal_file.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index;

/// As `tribotwin thermal` without --order.
ThermalFit fitted(const HeatSession& session) {
  auto second = *fit_thermal({&session, 1});
  const bool known =
      std::ranges::none_of(second.unidentifiable, [](const auto& name) { return name.starts_with("t"); });
  return known ? second : *fit_thermal({&session, 1}, {.order = thermal::Order::first});
}

/// Shares of the recorded temperatures within bands of other widths.
struct Coverage {
  double half = 0, whole = 0, twice = 0, samples = 0;

  void count(const std::vector<double>& predicted, const std::vector<double>& half_width,
             const std::vector<double>& recorded) {
    for (std::size_t i = 1; i < recorded.size(); ++i) {
      const double error = std::abs(predicted[i] - recorded[i]) / half_width[i];
      half += error <= 0.5, whole += error <= 1, twice += error <= 2, samples += 1;
    }
  }
  void expect_of_95_percent(const char* name) const {
    fmt::print("     {}: {:.1f} %, half as wide {:.1f} %, twice {:.1f} %\n", name, 100 * whole / samples,
               100 * half / samples, 100 * twice / samples);
    EXPECT_GE(whole, 0.9 * samples) << name;
    EXPECT_LE(whole, 0.99 * samples) << name;
    EXPECT_LE(half, 0.85 * samples) << name;   // a band half as wide would not hold
    EXPECT_GE(twice, 0.99 * samples) << name;  // and one twice as wide would say nothing
  }
};

constexpr double between_days_K = Surroundings::supposed_K;
const Disturbance disturbance{.white_K = 0.03, .slow_K = 0.1, .correlation_s = 200, .power_ripple = 0.02};
const Day training{.length_s = 4 * 3600, .step_s = 20, .power_w = {1.5, 0.5, 2.5}, .rested = false},
    other{.length_s = 4 * 3600, .step_s = 20, .power_w = {2.2, 1.0}, .rested = true};

TEST(ThermalBand, HoldsTheTemperaturesOfOtherDays) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  Coverage coverage, same_day;
  for (int k = 0, repeats = repeats_or(30); k < repeats; ++k) {
    const auto& joint = er3a[static_cast<std::size_t>(k) % er3a.size()];
    const auto day = [&](const Day& d) {
      return recorded(model_of(joint, 20 + between_days_K * normal(random)), d, disturbance, random);
    };
    const HeatSession first = day(training), second = day(other);
    const ThermalFit fit = fitted(first);
    coverage.count(predicted_temperature(fit.model, second), half_width_K(fit.model, *fit.uncertainty, second, false),
                   second.temperature_degC);
    same_day.count(predicted_temperature(fit.model, first), half_width_K(fit.model, *fit.uncertainty, first, true),
                   first.temperature_degC);
  }
  coverage.expect_of_95_percent("another day");
  fmt::print("     its own day: {:.1f} %\n", 100 * same_day.whole / same_day.samples);
  EXPECT_GE(same_day.whole, 0.9 * same_day.samples);
}

/// Three joints that warm each other; another day has other power and other surroundings.
std::vector<JointHeat> chain_day(const ThermalChain& truth, double power_w, const Disturbance& d,
                                 std::mt19937_64& random, double step_s = 30) {
  std::normal_distribution<double> normal;
  std::vector<JointHeat> joints;
  for (std::size_t j = 0; j < truth.joints.size(); ++j) {
    HeatSession s;
    for (double t = 0; t <= 2 * 3600; t += step_s) {
      s.time_s.push_back(t);
      s.power_w.push_back(t > 0 ? power_w * (1 + std::sin(t / (300.0 + 200.0 * static_cast<double>(j)))) : 0);
      s.temperature_degC.push_back(truth.ambient_degC[j] + static_cast<double>(j));
    }
    joints.push_back({truth.joints[j], {s}});
  }
  const Eigen::MatrixXd exact = predicted_temperatures(truth, joints, 0);
  for (std::size_t j = 0; j < joints.size(); ++j)
    for (std::size_t i = 0; i < joints[j].sessions[0].time_s.size(); ++i)
      joints[j].sessions[0].temperature_degC[i] =
          exact(static_cast<Index>(j), static_cast<Index>(i)) + d.white_K * normal(random);
  return joints;
}

TEST(ThermalBand, OfAChainHoldsTheTemperaturesOfOtherDays) {
  std::mt19937_64 random(4);
  std::normal_distribution<double> normal;
  Coverage coverage;
  for (int k = 0, repeats = repeats_or(20); k < repeats; ++k) {
    ThermalChain truth{.joints = {"a", "b", "c"},
                       .gain_K_J = {0.002, 0.003, 0.004},
                       .t_s = {2500, 2000, 1500},
                       .ambient_degC = {24, 25, 26},
                       .exchange_1_s = 3e-4};
    const auto first = chain_day(truth, 4, {.white_K = 0.05}, random);
    const double warmer_K = between_days_K * std::sqrt(2) * normal(random);  // than another day, both being days
    for (double& T : truth.ambient_degC) T += warmer_K;
    const auto second = chain_day(truth, 6, {.white_K = 0.05}, random);
    const auto fit = fit_thermal_chain(first);
    ASSERT_TRUE(fit) << fit.error().message;
    const Eigen::MatrixXd predicted = predicted_temperatures(fit->chain, second, 0),
                          half = half_widths_K(fit->chain, *fit->uncertainty, second, 0, false);
    for (Index j = 0; j < predicted.rows(); ++j) {
      const Eigen::VectorXd T = predicted.row(j), h = half.row(j);
      coverage.count({T.begin(), T.end()}, {h.begin(), h.end()},
                     second[static_cast<std::size_t>(j)].sessions[0].temperature_degC);
    }
  }
  coverage.expect_of_95_percent("a chain, another day");
}

// Of more than 300 samples means are fitted, whose noise is less than that of what was recorded.
TEST(ThermalBand, OfAChainHoldsItsOwnDayOfManySamples) {
  std::mt19937_64 random(6);
  const ThermalChain truth{.joints = {"a", "b", "c"},
                           .gain_K_J = {0.002, 0.003, 0.004},
                           .t_s = {2500, 2000, 1500},
                           .ambient_degC = {24, 25, 26},
                           .exchange_1_s = 3e-4};
  // From one sample to the next joints warm by 4 mK, or by more than their noise.
  for (const auto& [step_s, white_K] : {std::pair{2.0, 0.05}, {10.0, 0.01}}) {
    const auto day = chain_day(truth, 4, {.white_K = white_K}, random, step_s);
    const auto fit = fit_thermal_chain(day);
    ASSERT_TRUE(fit) << fit.error().message;
    EXPECT_NEAR(fit->uncertainty->noise.white, white_K, 0.1 * white_K) << step_s;
  }
}

TEST(ThermalBand, IsTheSameFromAFile) {
  std::mt19937_64 random(5);
  const HeatSession first = recorded(model_of(er3a[2]), training, disturbance, random),
                    second = recorded(model_of(er3a[2]), other, disturbance, random);
  const std::string file = testing::TempDir() + "thermal_band.yaml";
  for (const auto order : {thermal::Order::first, thermal::Order::second}) {
    const ThermalFit fit = *fit_thermal({&first, 1}, {.order = order});
    EXPECT_EQ(fit.uncertainty->slower.empty(), order == thermal::Order::second);
    std::ofstream(file) << to_yaml(std::vector<NamedThermalFit>{{"elbow", fit}}, {"day.csv"});
    const auto read = read_thermal(file);
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(half_width_K(read->front().model, *read->front().uncertainty, second, false),
              half_width_K(fit.model, *fit.uncertainty, second, false));
  }
}

TEST(ThermalBand, DaysTellHowSurroundingsVary) {
  EXPECT_EQ(Surroundings::of(std::vector{21.0}).deviation_K, Surroundings::supposed_K);
  EXPECT_LT(Surroundings::of(std::vector{21.0, 21.1, 20.9, 21.0}).deviation_K, 1.6);
  EXPECT_GT(Surroundings::of(std::vector{15.0, 25.0}).deviation_K, 3);
  EXPECT_EQ(Surroundings::of(std::vector{21.0}).variance(true), 0);
  EXPECT_EQ(Surroundings::of(std::vector{21.0}).variance(false), 8);
}

}  // namespace
}  // namespace tribotwin::twin::identification
