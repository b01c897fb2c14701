#include <algorithm>
#include <cmath>
#include <limits>

#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/robot/inertial_prior/inertial_prior.hpp>

namespace tribotwin::twin {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

VectorXd inertial_scale(const Regressor& regressor) {
  constexpr Index per_body = 10;
  const VectorXd phi = regressor.model_parameters();
  const Index bodies = (phi.size() - regressor.rotors()) / per_body;
  double heaviest = 0, widest = 0;
  for (Index b = 0; b < bodies; ++b) {
    const auto p = phi.segment<per_body>(per_body * b);  // Ixx Ixy Ixz Iyy Iyz Izz mx my mz m
    heaviest = std::max(heaviest, p(9));
    if (p(9) > 0) widest = std::max(widest, (p(0) + p(3) + p(5)) / (2 * p(9)));
  }
  VectorXd scale(phi.size());
  for (Index b = 0; b < bodies; ++b) {
    const auto p = phi.segment<per_body>(per_body * b);
    const double m = std::max(p(9), 0.01 * heaviest),
                 r2 = std::max(p(9) > 0 ? (p(0) + p(3) + p(5)) / (2 * p(9)) : 0, 1e-3 * widest);
    scale.segment<per_body>(per_body * b) << VectorXd::Constant(6, m * r2), VectorXd::Constant(3, m * std::sqrt(r2)), m;
  }
  const double smallest = 1e-3 * heaviest * widest;
  scale.tail(regressor.rotors()) = phi.tail(regressor.rotors()).cwiseMax(smallest);
  return scale;
}

MatrixXd prior_covariance(const Regressor& regressor, const BaseParameters& base) {
  constexpr double wide = 1e3;
  VectorXd scale = inertial_scale(regressor);
  const Index rotors = regressor.rotors();
  const VectorXd of_rotors = regressor.model_parameters().tail(rotors);
  const double heaviest_body = scale.head(scale.size() - rotors).maxCoeff();
  for (Index r = 0; r < rotors; ++r)
    if (of_rotors(r) == 0) scale(scale.size() - rotors + r) = wide * heaviest_body;
  const MatrixXd spread = base.from_all * scale.asDiagonal();
  return spread * spread.transpose();
}

namespace {

/// Logarithm of the probability of `estimate - model` under a prior of share s, up to a constant.
double log_evidence(const MatrixXd& of_data, const MatrixXd& of_prior, const VectorXd& deviation, double s) {
  const MatrixXd C = of_data + s * s * of_prior;
  const VectorXd scale = C.diagonal().cwiseSqrt().cwiseInverse();
  const auto L = cholesky_factor(scale.asDiagonal() * C * scale.asDiagonal());
  if (!L) return -std::numeric_limits<double>::infinity();
  const VectorXd white = L->triangularView<Eigen::Lower>().solve(scale.cwiseProduct(deviation));
  return -0.5 * white.squaredNorm() - L->diagonal().array().log().sum() + scale.array().log().sum();
}

}  // namespace

double most_probable_prior(const MatrixXd& of_data, const MatrixXd& of_prior, const VectorXd& deviation) {
  constexpr double narrowest = 0.05, widest = 10;
  constexpr int steps = 20;
  double best = 0, highest = -std::numeric_limits<double>::infinity();
  for (int k = 0; k <= steps; ++k) {
    const double s = narrowest * std::pow(widest / narrowest, k / static_cast<double>(steps));
    if (const double found = log_evidence(of_data, of_prior, deviation, s); found > highest)
      highest = found, best = k == steps ? 0 : s;
  }
  return best;
}

}  // namespace tribotwin::twin
