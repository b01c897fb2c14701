// The fit of a fleet's curves against observe(), dates and checksums.
#include <cmath>
#include <random>

#include <gmock/gmock.h>

#include <tribotwin/twin/diagnosis/fleet/level_curve.hpp>
#include <tribotwin/twin/identification/samples/samples.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

LevelCurve curve(std::mt19937_64& random) {
  constexpr std::array speeds{0.17,  0.87,  1.75,  2.62,  3.49,  5.24, 8.73, 13.96,
                              17.45, 26.18, 52.36, 78.54, 104.7, 140., 174.5};
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> temperature(25, 58);
  const double T = temperature(random), own = std::exp(.1 * normal(random));
  LevelCurve c;
  for (const double v : speeds) {
    const double l = .39 - .0003 * v, Fc = own * (4.75 + .0162 * T + 3.24 * l), Fs = own * (8.2 + 4.68 * l);
    c.speed_rad_s.push_back(v), c.load_norm.push_back(l), c.temperature_degC.push_back(T), c.stderr_nm.push_back(.05);
    c.friction_nm.push_back(Fc + (Fs - Fc) * std::exp(-std::pow(v / (2 + .025 * T), alpha)) +
                            3.4 * std::exp(-T / 32) * std::pow(v, .5 + .0025 * T) + .05 * normal(random));
  }
  return c;
}

TEST(ObserveLevels, FindsWhatObserveFinds) {
  std::mt19937_64 random(1);
  for (int i = 0; i < 60; ++i) {
    const LevelCurve c = curve(random);
    const identification::Samples samples{.speed = c.speed_rad_s,
                                          .load = c.load_norm,
                                          .temperature_degC = c.temperature_degC,
                                          .friction = c.friction_nm,
                                          .standard_error = c.stderr_nm,
                                          .curve = std::vector<std::uint32_t>(c.speed_rad_s.size(), 0)};
    const auto slow = observe(samples, 0.6);
    ASSERT_TRUE(slow);
    const Observation quick = observe_levels(c, 0.6);
    EXPECT_TRUE(quick.weak == slow->weak);
    for (Eigen::Index k = 0; k < feature_count; ++k) {
      const double sigma = quick.residual_nm * std::sqrt(quick.shape(k, k));
      EXPECT_NEAR(quick.logarithmic()(k), slow->logarithmic()(k), 0.01 * sigma)
          << i << ' ' << feature_names[static_cast<std::size_t>(k)];
      EXPECT_NEAR(quick.shape(k, k), slow->shape(k, k), 0.01 * slow->shape(k, k)) << i << ' ' << k;
    }
    EXPECT_NEAR(quick.residual_nm, slow->residual_nm, 1e-3 * slow->residual_nm);
  }
}

TEST(Time, OfDatesAndBack) {
  EXPECT_EQ(to_time("1970-01-02"), 86400);
  EXPECT_EQ(to_time("2026-11-23T08:17"), to_time("2026-11-23 08:17:00Z"));
  for (const char* date : {"2026-11-23", "2024-02-29", "2026-11-23T08:17:21"}) EXPECT_EQ(date_of(*to_time(date)), date);
  for (const char* wrong : {"", "2026-02-29", "23.11.2026", "2026-11-23T25:00", "2026-11-23x", "2026-11-2"})
    EXPECT_FALSE(to_time(wrong)) << wrong;
}

TEST(Checksum, SeesEveryNumberAndItsColumn) {
  std::mt19937_64 random(1);
  const LevelCurve c = curve(random);
  LevelCurve other = c;
  EXPECT_EQ(c.checksum(), other.checksum());
  other.friction_nm[3] = std::nextafter(other.friction_nm[3], 100);
  EXPECT_NE(c.checksum(), other.checksum());
  other = c;
  std::swap(other.load_norm, other.ripple_nm);
  EXPECT_NE(c.checksum(), other.checksum());
}

}  // namespace
}  // namespace tribotwin::twin::diagnosis::fleet
