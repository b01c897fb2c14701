#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <tribotwin/twin/numerics/correlated_noise.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

/// Unknowns of the search: logit of the slow part's share of the variance, log of its time.
struct Shape {
  double share, correlation_s;
};

bool begins_series(const SampleTimes& times, Index i) { return std::ranges::binary_search(times.first, i); }

/// The likelihood of a shape, its scale at the maximum.
class Likelihood {
 public:
  Likelihood(const VectorXd& residual, const MatrixXd& jacobian, const SampleTimes& times)
      : columns_(jacobian.cols() + 1, jacobian.rows()), times_(times) {
    columns_.topRows(jacobian.cols()) =
        (jacobian * jacobian.colwise().norm().cwiseMax(1e-300).cwiseInverse().asDiagonal()).transpose();
    columns_.bottomRows(1) = residual.transpose();
  }

  struct Value {
    double deviance = std::numeric_limits<double>::infinity();  ///< -2 log likelihood
    double variance = 0;                                        ///< white + slow
  };

  /// Kalman filter of the slow part through the residual and all columns at once: their innovations are white.
  Value at(const Shape& shape) const {
    const Index p = columns_.rows() - 1, n = columns_.cols();
    MatrixXd products = MatrixXd::Zero(p + 1, p + 1);
    VectorXd slow = VectorXd::Zero(p + 1), innovation(p + 1);
    double variance = shape.share, log_determinant = 0;
    for (Index i = 0; i < n; ++i) {
      if (begins_series(times_, i)) {
        slow.setZero(), variance = shape.share;
      } else {
        const double kept = std::exp(-step_s(i) / shape.correlation_s);
        slow *= kept, variance = kept * kept * variance + (1 - kept * kept) * shape.share;
      }
      const double total = variance + 1 - shape.share, gain = variance / total;
      innovation = columns_.col(i) - slow;
      slow += gain * innovation, variance *= 1 - gain;
      log_determinant += std::log(total);
      products.selfadjointView<Eigen::Lower>().rankUpdate(innovation, 1 / total);
    }
    return of(products, log_determinant);
  }

 private:
  double step_s(Index i) const {
    return times_.time_s[static_cast<std::size_t>(i)] - times_.time_s[static_cast<std::size_t>(i) - 1];
  }

  Value of(const MatrixXd& products, double log_determinant) const {
    const Index p = columns_.rows() - 1, n = columns_.cols();
    const MatrixXd whole = products.selfadjointView<Eigen::Lower>();
    const SymmetricEigen information = symmetric_eigen(whole.topLeftCorner(p, p));
    const VectorXd along = information.vectors.transpose() * whole.col(p).head(p);
    double squares = whole(p, p);
    Index rank = 0;
    for (Index k = 0; k < p; ++k) {
      if (information.values(k) <= 1e-12 * information.values(p - 1)) continue;
      squares -= along(k) * along(k) / information.values(k);
      log_determinant += std::log(information.values(k)), ++rank;
    }
    const double freedom = static_cast<double>(n - rank);
    if (!(squares > 0) || freedom < 1) return {};
    return {log_determinant + freedom * std::log(squares / freedom), squares / freedom};
  }

  MatrixXd columns_;  ///< parameters and then the residual x samples
  const SampleTimes& times_;
};

/// Length of the longest series and the mean step.
std::pair<double, double> extent(const SampleTimes& times) {
  double longest = 0, sum = 0;
  const auto n = static_cast<Index>(times.time_s.size());
  for (std::size_t s = 0; s < times.first.size(); ++s) {
    const Index last = (s + 1 < times.first.size() ? times.first[s + 1] : n) - 1;
    const double length =
        times.time_s[static_cast<std::size_t>(last)] - times.time_s[static_cast<std::size_t>(times.first[s])];
    longest = std::max(longest, length), sum += length;
  }
  return {longest, sum / std::max(1.0, static_cast<double>(n) - static_cast<double>(times.first.size()))};
}

/// A grid, then steps of half the size around the best.
std::pair<Shape, Likelihood::Value> search(const Likelihood& likelihood, const SampleTimes& times) {
  const auto [longest_s, step_s] = extent(times);
  const double low = std::log(step_s), high = std::log(std::max(longest_s, 2 * step_s));
  constexpr int times_of_grid = 5;
  double best[2] = {0, 0};
  Likelihood::Value lowest;
  const auto shape_of = [](double logit, double log_s) { return Shape{1 / (1 + std::exp(-logit)), std::exp(log_s)}; };
  const auto attempt = [&](double logit, double log_s) {
    const auto value = likelihood.at(shape_of(logit, std::clamp(log_s, low, high)));
    if (value.deviance >= lowest.deviance) return;
    lowest = value, best[0] = logit, best[1] = std::clamp(log_s, low, high);
  };
  for (const double logit : {-5.0, -2.0, 1.0, 4.0})
    for (int k = 0; k < times_of_grid; ++k) attempt(logit, low + (high - low) * (k + 0.5) / times_of_grid);
  // What a short record shows is the speed of the drift, slow^2 / correlation_s: hence the diagonal steps.
  constexpr double directions[][2] = {{1, 0}, {1, 1}, {0, 1}};
  for (double step = 1; step > 0.1;) {
    const double logit = best[0], log_s = best[1], before = lowest.deviance;
    for (const auto& d : directions)
      for (const double sign : {-step, step}) attempt(logit + sign * d[0], log_s + sign * d[1]);
    if (lowest.deviance > before - 0.1) step /= 2;
  }
  return {shape_of(best[0], best[1]), lowest};
}

/// V J: the slow part's kernel by one recursion forwards and one backwards.
MatrixXd times_covariance(const MatrixXd& J, const CorrelatedNoise& noise, const SampleTimes& times) {
  MatrixXd out = noise.white * noise.white * J;
  if (noise.correlation_s <= 0) return out;
  const auto kept = [&](Index i) {  // from sample i - 1 to i
    if (i >= J.rows() || begins_series(times, i)) return 0.0;
    const auto k = static_cast<std::size_t>(i);
    return std::exp(-(times.time_s[k] - times.time_s[k - 1]) / noise.correlation_s);
  };
  const double slow = noise.slow * noise.slow;
  Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(J.cols());
  for (Index i = 0; i < J.rows(); ++i) sum = kept(i) * sum + J.row(i), out.row(i) += slow * sum;
  sum.setZero();
  for (Index i = J.rows(); i-- > 0;) {
    sum *= kept(i + 1);
    out.row(i) += slow * sum;
    sum += J.row(i);
  }
  return out;
}

}  // namespace

double CorrelatedNoise::samples_per_independent(double step_s) const {
  if (correlation_s <= 0 || !(variance() > 0)) return 1;
  return std::max(1.0, (white * white + slow * slow / std::tanh(step_s / (2 * correlation_s))) / variance());
}

CorrelatedNoise correlated_noise(const VectorXd& residual, const MatrixXd& jacobian, const SampleTimes& times) {
  constexpr double akaike = 4;  // two parameters
  const double size = residual.norm();
  if (!(size > 0)) return {};
  const Likelihood likelihood(residual / size, jacobian, times);
  const auto white = likelihood.at({0, 1});
  const auto [shape, best] = search(likelihood, times);
  if (!(best.deviance < white.deviance - akaike)) return {.white = size * std::sqrt(white.variance)};
  return {.white = size * std::sqrt((1 - shape.share) * best.variance),
          .slow = size * std::sqrt(shape.share * best.variance),
          .correlation_s = shape.correlation_s};
}

MatrixXd least_squares_covariance(const MatrixXd& jacobian, const CorrelatedNoise& noise, const SampleTimes& times) {
  const VectorXd scale = jacobian.colwise().norm().cwiseMax(1e-300).cwiseInverse();
  const MatrixXd unit = jacobian * scale.asDiagonal();
  const SymmetricEigen eigen = symmetric_eigen(unit.transpose() * unit);
  MatrixXd inverse = MatrixXd::Zero(unit.cols(), unit.cols()), blind = inverse;
  for (Index k = 0; k < unit.cols(); ++k) {
    const VectorXd v = eigen.vectors.col(k);
    if (eigen.values(k) > 1e-12) {
      inverse += v * v.transpose() / eigen.values(k);
    } else {  // rounding must not make the parameters blind that it does not touch
      const VectorXd clean = v.unaryExpr([](double x) { return std::abs(x) < 1e-6 ? 0 : x; });
      blind += clean * clean.transpose() * 1e30 * noise.variance();
    }
  }
  const MatrixXd middle = unit.transpose() * times_covariance(unit, noise, times);
  return scale.asDiagonal() * (inverse * middle * inverse + blind) * scale.asDiagonal();
}

}  // namespace tribotwin::twin
