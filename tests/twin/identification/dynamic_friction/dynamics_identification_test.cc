#include <cmath>
#include <numbers>
#include <random>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <tribotwin/twin/identification/dynamic_friction/bouc_wen.hpp>
#include <tribotwin/twin/identification/dynamic_friction/bristles.hpp>

namespace tribotwin::twin::identification {
namespace {

using testing::Contains, testing::HasSubstr, testing::IsEmpty, testing::UnorderedElementsAre;
constexpr double pi = std::numbers::pi;

/// The gear of mjcf/rh380n_bench.xml.
const transmission::Hysteresis gear{.k = {{1.9e6, 6e3, -20}, {8e7, 2e5, 0}, {2e12, 0, 0}},
                                    .w = 0.65,
                                    .beta = 1500,
                                    .gamma = 300,
                                    .n = 1.2,
                                    .torsion_max_rad = 0.003};
const double gear_numbers[] = {1.9e6, 6e3, -20, 8e7, 2e5, 0, 2e12, 0, 0, 0.65, 1500, 300, 1.2};

/// 8 s at 250 Hz under about 3 kNm, loops within loops; the torque sensor is noisy, and so is the torsion: on the arm
/// side a motor encoder of 13 bit has 1.2 urad.
LoopRecording loops(double temperature, double torque_noise, double torsion_noise, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  LoopRecording r;
  double x = 0, before = 0;
  for (int i = 0; i < 2000; ++i) {
    const double t = i / 250.0, phi = 1.1e-3 * std::sin(2 * pi * 0.25 * t) +
                                      0.25e-3 * std::sin(2 * pi * 1.1 * t + 0.4) - 0.25e-3 * std::sin(0.4);
    x = transmission::advance(gear, x, phi - before);
    before = phi;
    r.torsion_rad.push_back(phi + torsion_noise * normal(random));
    r.torque_nm.push_back(transmission::torque_nm(gear, phi, x, temperature) + torque_noise * normal(random));
    r.temperature_degC.push_back(temperature);
  }
  return r;
}

std::vector<LoopRecording> bench(double torque_noise, double torsion_noise, std::uint64_t seed) {
  return {loops(20, torque_noise, torsion_noise, 3 * seed), loops(35, torque_noise, torsion_noise, 3 * seed + 1),
          loops(50, torque_noise, torsion_noise, 3 * seed + 2)};
}

TEST(BoucWen, FindsTheGearAndSigmasAreTheScatter) {
  constexpr int seeds = 10;
  double inside = 0, worst = 0, error = 0;
  for (int seed = 1; seed <= seeds; ++seed) {
    const auto f = fit_hysteresis(bench(5, 1.2e-6, static_cast<std::uint64_t>(seed)));
    ASSERT_TRUE(f) << f.error().message;
    ASSERT_THAT(f->unidentifiable, IsEmpty());
    for (std::size_t i = 0; i < 13; ++i) {
      const auto& e = f->parameters[i];
      const double off = std::abs(e.value - gear_numbers[i]) / e.sigma;
      if (seed == 1)
        fmt::print("{:6} {:12.5g} +- {:10.3g} truth {:10.4g}  {:.2f}\n", e.name, e.value, e.sigma, gear_numbers[i],
                   off);
      worst = std::max(worst, off);
      inside += off < 1.96;
    }
    error = std::max(error, f->normalised_mse);
  }
  fmt::print("covered {:.1f} %, largest error {:.2f} sigma, normalised MSE up to {:.2g}\n", 100 * inside / seeds / 13,
             worst, error);
  EXPECT_GT(inside / seeds / 13, 0.88);
  EXPECT_LT(worst, 4);
  EXPECT_LT(error, 1e-4);
}

TEST(BoucWen, SaysWhatTheDataCannotTell) {
  const auto one = fit_hysteresis(std::vector{loops(35, 5, 0, 1)});
  ASSERT_TRUE(one) << one.error().message;
  EXPECT_THAT(one->unidentifiable, UnorderedElementsAre("k01", "k02", "k11", "k12", "k21", "k22"));
  EXPECT_THAT(one->notes, Contains(HasSubstr("all samples are at 35 degC")));
  EXPECT_NEAR(one->parameters[0].value, 1.9e6 + 6e3 * 35 - 20 * 35 * 35, 4 * one->parameters[0].sigma);
  EXPECT_EQ(one->parameters[1].status, Status::held);
  const auto two = fit_hysteresis(std::vector{loops(20, 5, 0, 1), loops(50, 5, 0, 2)});
  ASSERT_TRUE(two) << two.error().message;
  EXPECT_THAT(two->unidentifiable, UnorderedElementsAre("k02", "k12", "k22"));
  EXPECT_THAT(two->notes, Contains(HasSubstr("near 20 or 50 degC")));

  // So little torsion that x follows it: a loop too thin to have a shape.
  LoopRecording small = loops(35, 0, 0, 1);
  std::mt19937_64 random(3);
  std::normal_distribution<double> noise(0, 5);
  double x = 0;
  for (std::size_t i = 0; i < small.torsion_rad.size(); ++i) {
    small.torsion_rad[i] *= 0.05;
    if (i) x = transmission::advance(gear, x, small.torsion_rad[i] - small.torsion_rad[i - 1]);
    small.torque_nm[i] = transmission::torque_nm(gear, small.torsion_rad[i], x, 35) + noise(random);
  }
  const auto thin = fit_hysteresis(std::vector{small});
  if (thin)
    EXPECT_THAT(thin->unidentifiable, Contains("beta"));
  else
    EXPECT_THAT(thin.error().message, HasSubstr("no hysteresis"));
}

TEST(BoucWen, RefusesWhatTeachesNothing) {
  const LoopRecording full = loops(35, 5, 0, 1);
  const auto error = [&](auto change) {
    LoopRecording r = full;
    change(r);
    const auto f = fit_hysteresis(std::vector{r});
    return f ? std::string("fitted") : f.error().message;
  };
  EXPECT_THAT(error([](auto& r) { std::ranges::fill(r.torsion_rad, 1e-3); }), HasSubstr("never changes"));
  EXPECT_THAT(error([](auto& r) { std::ranges::sort(r.torsion_rad); }), HasSubstr("reverses 0 times"));
  EXPECT_THAT(error([](auto& r) {
                for (auto* column : {&r.torsion_rad, &r.torque_nm, &r.temperature_degC}) column->resize(60);
                for (std::size_t i = 0; i < 60; ++i) r.torsion_rad[i] = 1e-3 * std::sin(0.3 * static_cast<double>(i));
              }),
              HasSubstr("60 samples are too few"));
  std::mt19937_64 random(3);
  std::normal_distribution<double> noise(0, 5);
  EXPECT_THAT(error([&](auto& r) {
                for (std::size_t i = 0; i < r.torque_nm.size(); ++i)
                  r.torque_nm[i] = 2e6 * r.torsion_rad[i] + noise(random);
              }),
              HasSubstr("no hysteresis"));
}

TEST(BoucWen, NoiseOfTheTorsionIsNoMotion) {
  std::mt19937_64 random(4);
  std::normal_distribution<double> noise(0, 2e-6);
  std::vector<double> clean, noisy;
  for (int i = 0; i < 16000; ++i) {
    clean.push_back(1e-3 * std::sin(2 * pi * i / 8000.0) + 2e-4 * std::sin(2 * pi * i / 1320.0));
    noisy.push_back(clean.back() + noise(random));
  }
  const auto way = [](const std::vector<double>& phi) {
    double sum = 0;
    for (std::size_t i = 1; i < phi.size(); ++i) sum += std::abs(phi[i] - phi[i - 1]);
    return sum;
  };
  std::vector<std::size_t> of_clean, of_noisy;
  EXPECT_THAT(monotone_course(clean, of_clean), testing::Pointwise(testing::DoubleNear(1e-9), clean));
  const auto course = monotone_course(noisy, of_noisy);
  EXPECT_EQ(of_clean.size(), of_noisy.size());
  EXPECT_GT(way(noisy), 1.3 * way(clean)) << "or this test shows nothing";
  EXPECT_NEAR(way(course), way(clean), 0.02 * way(clean));
}

/// The motor side of the same bench, and 10 s at 500 Hz: pre-sliding back and forth, then reversals faster and faster.
/// Bristles integrated by Runge-Kutta in steps of 20 us, with the equations written down once more.
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
  const double Fc = 1.6 + 0.02 * T, Fs = 2.4 + 0.025 * T + 1e-4 * T * T, vs = 6 + 0.05 * T - 2e-4 * T * T,
               Fv = 0.034 - 8e-4 * T + 6e-6 * T * T;
  const auto speed = [](double t) {
    return 0.08 * std::sin(2 * pi * 1.3 * t) + std::exp(0.45 * t - 3) * std::sin(2 * pi * 0.7 * t);
  };
  const auto rate = [&](double w, double z) {
    return w - sigma0 * std::abs(w) * z / (Fc + (Fs - Fc) * std::exp(-std::pow(std::abs(w) / vs, 1.4)));
  };
  SlidingRecording r;
  double z = 0;
  constexpr int samples = 5000, pieces = 100;
  constexpr double dt = 0.002, h = dt / pieces;
  for (int i = 0; i < samples; ++i) {
    const double t = i * dt, w = speed(t);
    r.time_s.push_back(t);
    r.velocity_rad_s.push_back(w + velocity_noise * normal(random));
    r.torque_nm.push_back(sigma0 * z + sigma1 * std::exp(-std::pow(w / vd, 2)) * rate(w, z) + Fv * w +
                          torque_noise * normal(random));
    r.temperature_degC.push_back(T);
    for (int k = 0; k < pieces; ++k) {
      const double s = t + k * h, a = rate(speed(s), z), b = rate(speed(s + h / 2), z + h / 2 * a),
                   c = rate(speed(s + h / 2), z + h / 2 * b), d = rate(speed(s + h), z + h * c);
      z += h / 6 * (a + 2 * b + 2 * c + d);
    }
  }
  return r;
}

TEST(LuGre, FindsTheBristlesAndSigmasAreTheScatter) {
  constexpr int seeds = 10;
  double worst = 0, error = 0;
  double inside[3] = {};
  for (int seed = 1; seed <= seeds; ++seed) {
    const auto f = fit_bristles(motor(), std::vector{reversals(30, 0.05, 1e-3, static_cast<std::uint64_t>(seed))});
    ASSERT_TRUE(f) << f.error().message;
    ASSERT_THAT(f->unidentifiable, IsEmpty());
    for (std::size_t i = 0; i < 3; ++i) {
      const auto& e = f->parameters[i];
      const double off = std::abs(e.value - bristle_numbers[i]) / e.sigma;
      if (seed == 1)
        fmt::print("{:6} {:8.4g} +- {:8.2g} truth {:4g}  {:.2f}\n", e.name, e.value, e.sigma, bristle_numbers[i], off);
      worst = std::max(worst, off);
      inside[i] += off < 1.96;
    }
    error = std::max(error, f->normalised_mse);
  }
  fmt::print("covered {:.0f} {:.0f} {:.0f} of {}, largest error {:.2f} sigma, normalised MSE up to {:.2g}\n", inside[0],
             inside[1], inside[2], seeds, worst, error);
  for (const double count : inside) EXPECT_GE(count, 7);
  EXPECT_LT(worst, 4);
  EXPECT_LT(error, 1e-3);
}

TEST(LuGre, SaysWhatTheDataCannotTell) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> noise(0, 0.02);
  SlidingRecording sliding = reversals(30, 0, 0, 1);
  const drive::Drive drive = motor();
  // Steady sliding one way: what the law says, and noise.
  for (std::size_t i = 0; i < sliding.time_s.size(); ++i) {
    sliding.velocity_rad_s[i] = 20 + 10 * std::sin(0.5 * sliding.time_s[i]);
    sliding.torque_nm[i] = friction::torque(drive.law, sliding.velocity_rad_s[i], 0, 30) + noise(random);
  }
  EXPECT_THAT(fit_bristles(drive, std::vector{sliding}).error().message, HasSubstr("no pre-sliding"));
  std::ranges::fill(sliding.velocity_rad_s, 0.0);
  EXPECT_THAT(fit_bristles(drive, std::vector{sliding}).error().message, HasSubstr("speed is 0 in every sample"));
  SlidingRecording few = reversals(30, 0.02, 0, 1);
  few.time_s.resize(20), few.velocity_rad_s.resize(20), few.torque_nm.resize(20), few.temperature_degC.resize(20);
  EXPECT_THAT(fit_bristles(drive, std::vector{few}).error().message, HasSubstr("20 samples are too few"));
  // So slow that damping has no effect: stiffness alone.
  SlidingRecording slow = reversals(30, 0.02, 0, 1);
  double z = 0;
  for (std::size_t i = 0; i < slow.time_s.size(); ++i) {
    slow.time_s[i] *= 1e4, slow.velocity_rad_s[i] *= 1e-4;
    const double w = slow.velocity_rad_s[i],
                 g = friction::level(drive.law, friction::at_temperature(drive.law, 30), w, 0).weakening;
    if (i)
      z = drive::advance({.sigma0 = 60}, z, 0.5 * (w + slow.velocity_rad_s[i - 1]), g,
                         slow.time_s[i] - slow.time_s[i - 1]);
    slow.torque_nm[i] = 60 * z + noise(random);
  }
  const auto f = fit_bristles(drive, std::vector{slow});
  ASSERT_TRUE(f) << f.error().message;
  EXPECT_NEAR(f->bristles.sigma0, 60, 4 * f->parameters[0].sigma);
  EXPECT_THAT(f->unidentifiable, UnorderedElementsAre("sigma1", "vd"));
}

}  // namespace
}  // namespace tribotwin::twin::identification
