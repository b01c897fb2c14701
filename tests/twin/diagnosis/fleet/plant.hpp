#pragma once

#include <cmath>
#include <random>

#include <tribotwin/twin/diagnosis/fleet/type_model.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

/// A plant of robots of one type, one joint each, with scatter between robots, days, temperatures and measurements.
/// Features as on the BR609's third joint.
namespace tribotwin::twin::diagnosis::fleet {

struct PlantOptions {
  std::size_t robots = 200, learned = 20, fewest_learned = 3, days = 10;
  double persistence = 0.8;   ///< of the deviation of the day
  double scale_freedom = 20;  ///< robots measure with different scatter
  double worn = 0.05, wear = 0.1;
};

/// Deviations by feature, and what all robots have in common.
struct PlantTruth {
  Features between = (Features() << .08, .07, .1, .1, .02).finished(),
           slopes = (Features() << .004, .003, .01, .01, .002).finished(),
           days = (Features() << .015, .012, .02, .02, .003).finished(),
           mean = (Features() << 1.9, 2.2, 1.1, -.1, .6).finished(),
           slope = (Features() << .02, .0, .08, -.31, .025).finished(),
           curvature = (Features() << -.001, 0, -.004, 0, 0).finished();
  /// Of the measurement, times independent normal numbers. Fits trade Fc for Vs, and Fv for beta.
  FeatureMatrix noise = (FeatureMatrix() << .006, 0, -.004, 0, 0,  //
                         0, .005, 0, 0, 0,                         //
                         0, 0, .04, 0, 0,                          //
                         0, 0, 0, .03, 0,                          //
                         0, 0, 0, -.008, .002)
                            .finished();
  std::array<double, 2> scatter{1e-4, 2e-4};  ///< typical claim of a fit
  double coldest_degC = 25, hottest_degC = 58;
};

/// The model of which plants are drawn, known exactly.
inline TypeModel true_model(const PlantOptions& o) {
  const PlantTruth truth;
  TypeModel t{.robots = o.robots,
              .temperature_low_degC = truth.coldest_degC,
              .temperature_high_degC = truth.hottest_degC,
              .knows_temperature = true};
  const FeatureMatrix noise = truth.noise * truth.noise.transpose();
  for (std::size_t r = 0; r < regions.size(); ++r) {
    const Eigen::Index first = regions[r].first, p = regions[r].count;
    const SymmetricEigen n = symmetric_eigen(noise.block(first, first, p, p));
    const Eigen::MatrixXd root = n.vectors * n.values.cwiseSqrt().cwiseInverse().asDiagonal() * n.vectors.transpose();
    const Eigen::MatrixXd day = truth.days.segment(first, p).cwiseAbs2().asDiagonal();
    const SymmetricEigen d = symmetric_eigen(root * day * root);
    RegionModel& m = t.region[r];
    m.decouple = d.vectors.transpose() * root, m.lambda = d.values;
    m.persistence = o.persistence;
    m.curvature = truth.curvature.segment(first, p);
    m.mean = Eigen::VectorXd(2 * p);
    m.between = m.mean_error = Eigen::MatrixXd::Zero(2 * p, 2 * p);
    const Eigen::VectorXd mean = m.decouple * truth.mean.segment(first, p),
                          slope = m.decouple * truth.slope.segment(first, p);
    const Eigen::MatrixXd levels = m.decouple * truth.between.segment(first, p).cwiseAbs2().asDiagonal() *
                                   m.decouple.transpose(),
                          slopes = m.decouple * truth.slopes.segment(first, p).cwiseAbs2().asDiagonal() *
                                   m.decouple.transpose();
    for (Eigen::Index i = 0; i < p; ++i) {
      m.mean(2 * i) = mean(i), m.mean(2 * i + 1) = slope(i);
      for (Eigen::Index k = 0; k < p; ++k)
        m.between(2 * i, 2 * k) = levels(i, k), m.between(2 * i + 1, 2 * k + 1) = slopes(i, k);
    }
    m.between_freedom = m.noise_freedom = 1e9;
    m.lambda_variance = m.scale_by_lambda = Eigen::VectorXd::Zero(p);
    m.typical_scatter = truth.scatter[r];
    m.scale_freedom = o.scale_freedom;
  }
  return t;
}

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
    const PlantTruth truth;
    const Features own = truth.mean + scattered(truth.between), own_slope = truth.slope + scattered(truth.slopes);
    std::chi_squared_distribution<double> chi(options_.scale_freedom);
    const double scale = std::sqrt(options_.scale_freedom / chi(random_));
    std::uniform_int_distribution<std::size_t> count(options_.fewest_learned, options_.learned);
    std::uniform_real_distribution<double> temperature(truth.coldest_degC, truth.hottest_degC), chance(0, 1);
    const std::size_t learned = count(random_);
    Joint j{.worn = chance(random_) < options_.worn};
    Features day = scattered(truth.days);
    for (std::size_t i = 0; i < learned + options_.days; ++i) {
      const double phi = options_.persistence;
      if (i > 0) day = phi * day + std::sqrt(1 - phi * phi) * scattered(truth.days);
      Row row{.day = 20000 + static_cast<double>(i), .temperature_degC = temperature(random_)};
      const double t = (row.temperature_degC - 41.5) / 10, v = std::exp(.3 * normal());
      row.load_norm = .37;
      row.scatter = {v * truth.scatter[0], v * truth.scatter[1]};
      const double a = normal(), b = normal(), c = normal(), d = normal(), e = normal();
      const Features noise = truth.noise * (Features() << a, b, c, d, e).finished();
      row.logarithmic = own + t * own_slope + t * t * truth.curvature + scale * (day + std::sqrt(v) * noise);
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
