#pragma once

#include <cmath>
#include <random>

#include <tribotwin/twin/diagnosis/fleet/claims.hpp>
#include <tribotwin/twin/diagnosis/fleet/level_curve.hpp>
#include <tribotwin/twin/diagnosis/healthy.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

/// A plant of robots of one type, one joint each, with scatter between robots, days, temperatures and measurements.
/// Features as on the BR609's third joint.
namespace tribotwin::twin::diagnosis::fleet {

struct PlantOptions {
  std::size_t robots = 200, learned = 20, fewest_learned = 3, days = 10;
  double persistence = 0.8;   ///< of the deviation of the day
  double scale_freedom = 20;  ///< robots measure with different scatter
  double worn = 0.05, wear = 0.1;
  double claims = 0;    ///< deviation of ln of what fits claim for a feature, from robot to robot; 0: no claims
  bool fitted = false;  ///< features are fits of levels with noise, as in fleet_plant.py, and not drawn
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

/// Covariance that a typical fit claims: proportional to that of its errors in each region.
inline FeatureMatrix typical_claim() {
  const PlantTruth truth;
  FeatureMatrix out = FeatureMatrix::Zero();
  const FeatureMatrix noise = truth.noise * truth.noise.transpose();
  for (std::size_t r = 0; r < regions.size(); ++r) {
    const Eigen::Index first = regions[r].first, p = regions[r].count;
    const Eigen::MatrixXd own = noise.block(first, first, p, p);
    out.block(first, first, p, p) = truth.scatter[r] / std::pow(determinant(own), 1.0 / static_cast<double>(p)) * own;
  }
  return out;
}

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
    if (o.claims > 0) m.typical_root = *cholesky_factor(typical_claim().block(first, first, p, p));
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
    for (std::size_t r = 0; r < o.robots; ++r) joints.push_back(o.fitted ? fitted() : joint());
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
    const FeatureMatrix trade = claims();
    for (std::size_t i = 0; i < learned + options_.days; ++i) {
      const double phi = options_.persistence;
      if (i > 0) day = phi * day + std::sqrt(1 - phi * phi) * scattered(truth.days);
      Row row{.day = 20000 + static_cast<double>(i), .temperature_degC = temperature(random_)};
      const double t = (row.temperature_degC - 41.5) / 10, v = std::exp(.3 * normal());
      row.load_norm = .37;
      row.scatter = {v * truth.scatter[0], v * truth.scatter[1]};
      if (options_.claims > 0) row.claim = claim_roots(v * trade * typical_claim() * trade);
      const double a = normal(), b = normal(), c = normal(), d = normal(), e = normal();
      const Features noise = truth.noise * (Features() << a, b, c, d, e).finished();
      row.logarithmic = own + t * own_slope + t * t * truth.curvature + scale * (day + std::sqrt(v) * (trade * noise));
      if (i >= learned && j.worn) row.logarithmic.head(3).array() += std::log1p(options_.wear);
      (i < learned ? j.healthy : j.recent).push_back(row);
    }
    return j;
  }

  /// By how much a robot's fits know some features better and others worse than typical ones, the size of each region's
  /// claim the same.
  FeatureMatrix claims() {
    FeatureMatrix out = FeatureMatrix::Identity();
    if (options_.claims > 0)
      for (const auto& r : regions) {
        Eigen::VectorXd log(r.count);
        for (double& x : log) x = options_.claims * normal();
        log.array() -= log.mean();
        out.diagonal().segment(r.first, r.count) = log.array().exp();
      }
    return out;
  }

  /// As Joint of fleet_plant.py.
  Joint fitted() {
    constexpr std::array between{.08, .07, .1, .1};
    std::array<double, 4> own{}, day{};
    for (std::size_t k = 0; k < own.size(); ++k) own[k] = std::exp(between[k] * normal());
    for (double& d : day) d = .015 * normal();
    std::chi_squared_distribution<double> chi(options_.scale_freedom);
    const double noise_nm = .05 * std::sqrt(options_.scale_freedom / chi(random_)), phi = options_.persistence;
    std::uniform_int_distribution<std::size_t> count(options_.fewest_learned, options_.learned);
    std::uniform_real_distribution<double> temperature(25, 58), chance(0, 1);
    const std::size_t learned = count(random_);
    Joint j{.worn = chance(random_) < options_.worn};
    for (std::size_t i = 0; i < learned + options_.days; ++i) {
      for (double& d : day) d = phi * d + std::sqrt(1 - phi * phi) * .015 * normal();
      std::array<double, 4> now = own;
      for (std::size_t k = 0; k < now.size(); ++k) now[k] *= std::exp(day[k]);
      const double T = temperature(random_);
      const Observation o = observe_levels(curve(now, T, i >= learned && j.worn ? options_.wear : 0, noise_nm), .6);
      if (!o.weak.empty()) continue;
      (i < learned ? j.healthy : j.recent)
          .push_back({.day = 20000 + static_cast<double>(i),
                      .temperature_degC = T,
                      .load_norm = .37,
                      .logarithmic = o.logarithmic(),
                      .scatter = {shape_scatter(o.shape, regions[0]), shape_scatter(o.shape, regions[1])},
                      .claim = claim_roots(o.shape)});
    }
    return j;
  }
  LevelCurve curve(const std::array<double, 4>& own, double T, double wear, double noise_nm) {
    constexpr std::array speeds{.17,   .87,   1.75,  2.62,  3.49,  5.24,  8.73, 13.96,
                                17.45, 26.18, 52.36, 78.54, 104.7, 139.6, 174.5};
    constexpr std::array loads{.39, .39, .39, .39, .39, .39, .39, .38, .38, .36, .35, .30, .32, .34, .36};
    LevelCurve c;
    for (std::size_t i = 0; i < speeds.size(); ++i) {
      const double v = speeds[i], at_rest = 7.8 + 4.68 * loads[i],
                   Fc = (1 + wear) * own[0] * (4.752 + .0162 * T + 3.24 * loads[i]),
                   Fs = (1 + wear) * std::max(own[1] * at_rest, 1.02 * Fc), Vs = (1 + wear) * own[2] * (2 + .025 * T);
      c.speed_rad_s.push_back(v), c.load_norm.push_back(loads[i]);
      c.temperature_degC.push_back(T), c.stderr_nm.push_back(.05);
      c.friction_nm.push_back(Fc + (Fs - Fc) * std::exp(-std::pow(v / Vs, alpha)) +
                              own[3] * 3.39855 * std::exp(-T / 32) * std::pow(v, .5 + .0025 * T) + noise_nm * normal());
    }
    return c;
  }

  const PlantOptions options_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

}  // namespace tribotwin::twin::diagnosis::fleet
