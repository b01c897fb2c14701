#include <cmath>
#include <numbers>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/twin/identification/bouc_wen.hpp>
#include <tribotwin/twin/identification/bristles.hpp>

namespace tribotwin::twin::identification {
namespace {

using testing::Contains, testing::HasSubstr, testing::IsEmpty, testing::UnorderedElementsAre;
constexpr double pi = std::numbers::pi;

/// The gear of mjcf/rh380n_bench.xml.
const transmission::Hysteresis gear{.k = {{1.9e6, 6e3, -20}, {8e7, 2e5, 0}, {2e12, 0, 0}}, .w = 0.65, .beta = 1500, .gamma = 300, .n = 1.2, .torsion_max_rad = 0.003};
const double gear_numbers[] = {1.9e6, 6e3, -20, 8e7, 2e5, 0, 2e12, 0, 0, 0.65, 1500, 300, 1.2};

/// 8 s at 250 Hz under about 3 kNm, loops within loops; the torque sensor and both encoders are noisy.
LoopRecording loops(double temperature, double torque_noise, double torsion_noise, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  LoopRecording r;
  double x = 0, before = 0;
  for (int i = 0; i < 2000; ++i) {
    const double t = i / 250.0, phi = 1.1e-3 * std::sin(2 * pi * 0.25 * t) + 0.25e-3 * std::sin(2 * pi * 1.1 * t + 0.4) - 0.25e-3 * std::sin(0.4);
    x = transmission::advanced(gear, x, phi - before);
    before = phi;
    r.torsion_rad.push_back(phi + torsion_noise * normal(random));
    r.torque_nm.push_back(transmission::torque_nm(gear, phi, x, temperature) + torque_noise * normal(random));
    r.temperature_degC.push_back(temperature);
  }
  return r;
}

std::vector<LoopRecording> bench(double torque_noise, double torsion_noise, std::uint64_t seed) {
  return {loops(20, torque_noise, torsion_noise, 3 * seed), loops(35, torque_noise, torsion_noise, 3 * seed + 1), loops(50, torque_noise, torsion_noise, 3 * seed + 2)};
}

TEST(BoucWen, FindsTheGearAndSigmasAreTheScatter) {
  constexpr int seeds = 40;
  double inside = 0, worst = 0, error = 0;
  for (int seed = 1; seed <= seeds; ++seed) {
    const auto f = fit_hysteresis(bench(5, 5e-7, static_cast<std::uint64_t>(seed)));
    ASSERT_TRUE(f) << f.error();
    ASSERT_THAT(f->unidentifiable, IsEmpty());
    for (std::size_t i = 0; i < 13; ++i) {
      const auto& e = f->parameters[i];
      const double off = std::abs(e.value - gear_numbers[i]) / e.sigma;
      if (seed == 1) fmt::print("{:6} {:12.5g} +- {:10.3g} truth {:10.4g}  {:.2f}\n", e.name, e.value, e.sigma, gear_numbers[i], off);
      worst = std::max(worst, off);
      inside += off < 1.96;
    }
    error = std::max(error, f->normalised_mse);
  }
  fmt::print("covered {:.1f} %, largest error {:.2f} sigma, normalised MSE up to {:.2g}\n", 100 * inside / seeds / 13, worst, error);
  EXPECT_GT(inside / seeds / 13, 0.92);
  EXPECT_LT(inside / seeds / 13, 0.985);
  EXPECT_LT(worst, 4);
  EXPECT_LT(error, 1e-4);
}

/// The motor side of the same bench, and 10 s at 500 Hz: pre-sliding to and fro, then reversals faster and faster. Bristles
/// integrated by Runge-Kutta in steps of 20 us, with the equations written down once more.
drive::Drive motor() {
  const auto numbers = {1.6, 0.02, 0.0, 2.4, 0.025, 1e-4, 6.0, 0.05, -2e-4, 1.4, 0.034, -8e-4, 6e-6};
  friction::Law law{.info = friction::find_law("stribeck_T"), .range = friction::find_law("stribeck_T")->identified};
  return {.name = "motor", .law = friction::with_parameters(law, numbers), .torque_max_nm = 20};
}
const double bristle_numbers[] = {60, 0.6, 2};

SlidingRecording reversals(double T, double torque_noise, double velocity_noise, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  const auto [sigma0, sigma1, vd] = bristle_numbers;
  const double Fc = 1.6 + 0.02 * T, Fs = 2.4 + 0.025 * T + 1e-4 * T * T, vs = 6 + 0.05 * T - 2e-4 * T * T, Fv = 0.034 - 8e-4 * T + 6e-6 * T * T;
  const auto speed = [](double t) { return 0.08 * std::sin(2 * pi * 1.3 * t) + std::exp(0.45 * t - 3) * std::sin(2 * pi * 0.7 * t); };
  const auto rate = [&](double w, double z) { return w - sigma0 * std::abs(w) * z / (Fc + (Fs - Fc) * std::exp(-std::pow(std::abs(w) / vs, 1.4))); };
  SlidingRecording r;
  double z = 0;
  constexpr int samples = 5000, pieces = 100;
  constexpr double dt = 0.002, h = dt / pieces;
  for (int i = 0; i < samples; ++i) {
    const double t = i * dt, w = speed(t);
    r.time_s.push_back(t);
    r.velocity_rad_s.push_back(w + velocity_noise * normal(random));
    r.torque_nm.push_back(sigma0 * z + sigma1 * std::exp(-std::pow(w / vd, 2)) * rate(w, z) + Fv * w + torque_noise * normal(random));
    r.temperature_degC.push_back(T);
    for (int k = 0; k < pieces; ++k) {
      const double s = t + k * h, a = rate(speed(s), z), b = rate(speed(s + h / 2), z + h / 2 * a), c = rate(speed(s + h / 2), z + h / 2 * b), d = rate(speed(s + h), z + h * c);
      z += h / 6 * (a + 2 * b + 2 * c + d);
    }
  }
  return r;
}

TEST(LuGre, FindsTheBristlesAndSigmasAreTheScatter) {
  constexpr int seeds = 40;
  double worst = 0, error = 0;
  double inside[3] = {};
  for (int seed = 1; seed <= seeds; ++seed) {
    const auto f = fit_bristles(motor(), std::vector{reversals(30, 0.05, 1e-3, static_cast<std::uint64_t>(seed))});
    ASSERT_TRUE(f) << f.error();
    ASSERT_THAT(f->unidentifiable, IsEmpty());
    for (std::size_t i = 0; i < 3; ++i) {
      const auto& e = f->parameters[i];
      const double off = std::abs(e.value - bristle_numbers[i]) / e.sigma;
      if (seed == 1) fmt::print("{:6} {:8.4g} +- {:8.2g} truth {:4g}  {:.2f}\n", e.name, e.value, e.sigma, bristle_numbers[i], off);
      worst = std::max(worst, off);
      inside[i] += off < 1.96;
    }
    error = std::max(error, f->normalised_mse);
  }
  fmt::print("covered {:.0f} {:.0f} {:.0f} of {}, largest error {:.2f} sigma, normalised MSE up to {:.2g}\n", inside[0], inside[1], inside[2], seeds, worst, error);
  for (const double count : inside) EXPECT_GE(count, 34);
  EXPECT_LT(worst, 4);
  EXPECT_LT(error, 1e-3);
}

}  // namespace
}  // namespace tribotwin::twin::identification
