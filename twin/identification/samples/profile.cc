#include <algorithm>
#include <cmath>

#include <tribotwin/twin/identification/samples/profile.hpp>
#include <tribotwin/twin/numerics/correlation.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::curves {
namespace {

/// Legendre polynomials of x.
void legendre(double x, Eigen::Ref<Eigen::VectorXd> out) {
  out[0] = 1;
  if (out.size() > 1) out[1] = x;
  for (Eigen::Index k = 2; k < out.size(); ++k) {
    const auto n = static_cast<double>(k);
    out[k] = ((2 * n - 1) * x * out[k - 1] - (n - 1) * out[k - 2]) / n;
  }
}

}  // namespace

Mean mean_of(std::span<const double> x, double fitted) {
  const double n = static_cast<double>(x.size());
  double mean = 0, variance = 0;
  for (const double v : x) mean += v / n;
  for (const double v : x) variance += (v - mean) * (v - mean) / n;
  if (!(variance > 0)) return {mean, 0};
  return {mean, std::sqrt(variance / std::max(1.0, n - fitted) * samples_per_independent(x, fitted))};
}

Profile::Profile(const JointRecording& r, const Pair& pair) : r_(r), pair_(pair) {
  centre_ = 0.5 * (pair.low + pair.high);
  half_ = std::max(0.5 * (pair.high - pair.low), 1e-12);
  take(pair.forward, +1);
  take(pair.reverse, -1);
  const auto n = static_cast<double>(rows_.size());
  // Enough for a sine over the travel; gravity has no more, gears have.
  degree_ = static_cast<int>(std::min({3 + std::ceil(3.2 * half_), 20.0, n / 12}));
}

double Profile::torque(const Row& row, double lag_s) const {
  if (lag_s == 0) return r_.torque_nm[row.sample];
  const double t = r_.time_s[row.sample] + lag_s;
  std::size_t i = row.sample;
  while (i + 2 < r_.size() && r_.time_s[i + 1] < t) ++i;
  while (i > 0 && r_.time_s[i] > t) --i;
  const std::size_t k = std::min(i + 1, r_.size() - 1);
  if (i == k) return r_.torque_nm[i];
  const double w = std::clamp((t - r_.time_s[i]) / (r_.time_s[k] - r_.time_s[i]), 0.0, 1.0);
  return (1 - w) * r_.torque_nm[i] + w * r_.torque_nm[k];
}

void Profile::fit(double lag_s) {
  const Eigen::Index columns = degree_ + 2;
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(columns, columns);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(columns), basis(columns);
  for (const Row& row : rows_) {
    legendre(row.x, basis);
    basis[columns - 1] = row.sign;
    gram.selfadjointView<Eigen::Lower>().rankUpdate(basis);
    right += torque(row, lag_s) * basis;
  }
  const Eigen::VectorXd solution = symmetric_solution(gram, right);
  common_ = solution.head(columns - 1);
  friction_ = solution[columns - 1];
}

Profile::Difference Profile::difference(double lag_s) const {
  Difference d;
  const auto beyond = [&](std::size_t i) { return torque(rows_[i], lag_s) - common_nm(rows_[i].x); };
  std::size_t k = rows_.size() - 1;  // reverse positions fall with time
  double after = beyond(k), before = beyond(k - 1);
  for (std::size_t i = 0; i < forward_; ++i) {
    while (k > forward_ + 1 && rows_[k - 1].x < rows_[i].x) {
      --k;
      after = before;
      before = beyond(k - 1);
    }
    const double w = std::clamp((rows_[i].x - rows_[k].x) / (rows_[k - 1].x - rows_[k].x), 0.0, 1.0);
    d.x.push_back(rows_[i].x);
    d.friction_nm.push_back(0.5 * (beyond(i) - (w * before + (1 - w) * after)));
  }
  return d;
}

Profile::Information Profile::information(double lag_s) const {
  const Difference d = difference(lag_s);
  const auto n = static_cast<Eigen::Index>(d.x.size());
  Eigen::MatrixXd known(n, 3);
  double square = 0, sum = 0;
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto [common, slope] = evaluate(d.x[static_cast<std::size_t>(i)]);
    known.row(i) << 1, std::abs(common), -pair_.speed() * slope / half_;
    square += common * common;
    sum += common;
  }
  const double count = static_cast<double>(n), spread = square - sum * sum / count;
  if (spread < 1e-6 * count * friction_ * friction_) return {};
  const Eigen::Map<const Eigen::VectorXd> y(d.friction_nm.data(), n);
  const ShortestSolution free(known.leftCols(2));
  const Eigen::VectorXd by_lag = known.col(2) - known.leftCols(2) * free(known.col(2)),
                        rest = y - known.leftCols(2) * free(y);
  const double length = by_lag.squaredNorm();
  if (!(length > 0)) return {};
  const double change = by_lag.dot(rest) / length;
  const Eigen::VectorXd noise = rest - change * by_lag;
  const double variance = std::pow(mean_of({noise.data(), d.x.size()}, 3).stderr_, 2) * count;
  if (!(spread > 10 * static_cast<double>(degree_) * variance)) return {};
  return {length, length * change, std::max(variance, 1e-12 * square / count), count};
}

void Profile::take(const Pass& pass, double sign) {
  for (std::size_t i = pass.begin; i < pass.end; ++i) {
    const double q = pass.at + pass.speed * (r_.time_s[i] - r_.time_s[pass.begin]);  // free of quantisation
    if (q >= pair_.low && q <= pair_.high) rows_.push_back({i, scaled(q), sign});
  }
  if (sign > 0) forward_ = rows_.size();
}

std::pair<double, double> Profile::evaluate(double x) const {
  double p0 = 1, p1 = x, d0 = 0, d1 = 1, value = common_[0], slope = 0;
  for (Eigen::Index k = 1; k < common_.size(); ++k) {
    value += common_[k] * p1;
    slope += common_[k] * d1;
    const auto n = static_cast<double>(k);
    const double p2 = ((2 * n + 1) * x * p1 - n * p0) / (n + 1), d2 = d0 + (2 * n + 1) * p1;
    p0 = p1, p1 = p2, d0 = d1, d1 = d2;
  }
  return {value, slope};
}

}  // namespace tribotwin::twin::curves
