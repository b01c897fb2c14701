#include <algorithm>
#include <cmath>

#include <tribotwin/twin/diagnosis/healthy.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::diagnosis {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

double shape_scatter(const FeatureMatrix& shape, const RegionFeatures& r) {
  const double d = determinant(shape.block(r.first, r.first, r.count, r.count));
  return d > 0 ? std::pow(d, 1.0 / static_cast<double>(r.count)) : 0;
}

Baseline regression(const MatrixXd& x, const MatrixXd& y, const VectorXd& scatter) {
  const VectorXd root = scatter.cwiseSqrt().cwiseInverse();
  const MatrixXd X = root.asDiagonal() * x, Y = root.asDiagonal() * y;
  Baseline b{.inverse_gram = inverse(X.transpose() * X), .freedom = static_cast<double>(x.rows() - x.cols())};
  b.coefficients = least_squares_solutions(X, Y);
  const MatrixXd R = Y - X * b.coefficients;
  b.covariance = R.transpose() * R / b.freedom;
  return b;
}

double Baseline::limit(double false_alarm) const {
  const auto p = static_cast<double>(covariance.rows());
  return p * freedom / (freedom - p + 1) * fisher_f_upper_quantile(p, freedom - p + 1, false_alarm);
}

double Baseline::exceeded_by_chance(double statistic) const {
  const auto p = static_cast<double>(covariance.rows());
  return fisher_f_above(p, freedom - p + 1, statistic * (freedom - p + 1) / (p * freedom));
}

VectorXd HealthyState::regressors(std::optional<double> temperature_degC) const {
  VectorXd x = VectorXd::Ones(knows_temperature ? 2 : 1);
  if (knows_temperature) x(1) = temperature_degC.value_or(temperature_reference_degC()) - temperature_reference_degC();
  return x;
}

double HealthyState::scatter_of(const Observation& o, std::size_t which) const {
  const double own = shape_scatter(o.shape, regions[which]);
  return own > 0 && scatter[which] > 0 ? own / scatter[which] : 1;
}

Features HealthyState::deviation(const Observation& o) const {
  const VectorXd x = regressors(o.temperature_degC);
  Features expected;
  expected << region[0].predicted(x), region[1].predicted(x);
  return o.logarithmic() - expected;
}

double HealthyState::distance(const Features& features, std::size_t which) const {
  const auto& r = regions[which];
  const VectorXd d = (features - mean).segment(r.first, r.count);
  return d.dot(symmetric_solution(covariance.block(r.first, r.first, r.count, r.count), d));
}

VectorXd HealthyState::radii(std::size_t which) const {
  const auto& r = regions[which];
  return symmetric_eigenvalues(covariance.block(r.first, r.first, r.count, r.count)).cwiseMax(0).cwiseSqrt();
}

double HealthyState::sensitivity_at_mean_load() const {
  return load_sensitivity / (1 + load_sensitivity * (indicators[load] ? indicators[load]->mean : 0));
}

bool HealthyState::extrapolates(const Observation& o) const {
  constexpr double near_K = 2;
  return knows_temperature &&
         (*o.temperature_degC < temperature_low_degC - near_K || *o.temperature_degC > temperature_high_degC + near_K);
}

double HealthyState::load_term(double extra) const {
  const double k = sensitivity_at_mean_load();
  return k > 0 ? std::log1p(std::max(k * extra, -0.99)) / k : extra;
}

double HealthyState::load_of_term(double term) const {
  const double k = sensitivity_at_mean_load();
  return k > 0 ? std::expm1(k * term) / k : term;
}

double HealthyState::wear_load() const {
  Features along = mean;  // per load_norm, in the features' own units
  along.head(4) = mean.head(4).cwiseProduct(load_effect.head(4));
  const double per_load = std::sqrt(distance(mean + along, 0));
  return per_load > 0 ? std::sqrt(wear_distance) / per_load : 0;
}

}  // namespace tribotwin::twin::diagnosis
