#pragma once

#include <cmath>
#include <random>

#include <tribotwin/twin/diagnosis/fleet/row.hpp>

/// A plant of robots of one type, one joint each, with scatter between robots, days, temperatures and measurements.
/// Features as on the BR609's third joint.
namespace tribotwin::twin::diagnosis::fleet {

struct PlantOptions {
  std::size_t robots = 200, learned = 20, fewest_learned = 3, days = 10;
  double persistence = 0.8;   ///< of the deviation of the day
  double scale_freedom = 20;  ///< robots measure with different scatter
  double worn = 0.05, wear = 0.1;
};

struct Joint {
  Rows healthy, recent;
  bool worn = false;
};

class Plant {
 public:
  Plant(const PlantOptions& o, unsigned seed) : options_(o), random_(seed) {
    for (std::size_t r = 0; r < o.robots; ++r) joints.push_back(joint());
  }
  std::vector<Joint> joints;

 private:
  double normal() { return normal_(random_); }
  Features scattered(const Features& deviation) {
    Features x;
    for (Eigen::Index i = 0; i < feature_count; ++i) x(i) = deviation(i) * normal();
    return x;
  }

  Joint joint() {
    const Features between = (Features() << .08, .07, .1, .1, .02).finished(),
                   slopes = (Features() << .004, .003, .01, .01, .002).finished(),
                   days = (Features() << .015, .012, .02, .02, .003).finished(),
                   mean = (Features() << 1.9, 2.2, 1.1, -.1, .6).finished(),
                   slope = (Features() << .02, .0, .08, -.31, .025).finished(),
                   curvature = (Features() << -.001, 0, -.004, 0, 0).finished();
    const Features own = mean + scattered(between), own_slope = slope + scattered(slopes);
    std::chi_squared_distribution<double> chi(options_.scale_freedom);
    const double scale = std::sqrt(options_.scale_freedom / chi(random_));
    std::uniform_int_distribution<std::size_t> count(options_.fewest_learned, options_.learned);
    std::uniform_real_distribution<double> temperature(25, 58), chance(0, 1);
    const std::size_t learned = count(random_);
    Joint j{.worn = chance(random_) < options_.worn};
    Features day = scattered(days);
    for (std::size_t i = 0; i < learned + options_.days; ++i) {
      const double phi = options_.persistence;
      if (i > 0) day = phi * day + std::sqrt(1 - phi * phi) * scattered(days);
      Row row{.day = 20000 + static_cast<double>(i), .temperature_degC = temperature(random_)};
      const double t = (row.temperature_degC - 41.5) / 10, v = std::exp(.3 * normal());
      row.load_norm = .37;
      row.scatter = {v * 1e-4, v * 2e-4};
      // Fits trade Fc for Vs, and Fv for beta.
      const double a = normal(), b = normal(), c = normal(), d = normal(), e = normal();
      const Features noise =
          (Features() << .006 * a - .004 * c, .005 * b, .04 * c, .03 * d, -.008 * d + .002 * e).finished();
      row.logarithmic = own + t * own_slope + t * t * curvature + scale * (day + std::sqrt(v) * noise);
      if (i >= learned && j.worn) row.logarithmic.head(3).array() += std::log1p(options_.wear);
      (i < learned ? j.healthy : j.recent).push_back(row);
    }
    return j;
  }

  const PlantOptions options_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

}  // namespace tribotwin::twin::diagnosis::fleet
