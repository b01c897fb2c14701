#include <algorithm>
#include <cmath>

#include <tribotwin/twin/diagnosis/fleet/estimates.hpp>
#include <tribotwin/twin/diagnosis/fleet/joint_fit.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

using Eigen::Index;

constexpr double lambda_step = 0.2;             ///< of ln lambda, for the effect of lambda on a variance
constexpr double lambda_variance_known = 1e-4;  ///< variance of ln lambda below which it counts as known

RegressionMatrix inverse_of(const RegressionMatrix& positive) {
  return positive.llt().solve(RegressionMatrix::Identity(positive.rows(), positive.cols()));
}

/// D of z in coordinates w, z = `back` w.
RegressionMatrix turned(const RegressionMatrix& D, const SmallMatrix& back) {
  const Index p = back.rows(), q = D.rows() / p;
  RegressionMatrix by_block = RegressionMatrix::Zero(p * q, p * q);
  for (Index i = 0; i < p; ++i)
    for (Index k = 0; k < p; ++k) by_block.block(i * q, k * q, q, q).diagonal().setConstant(back(i, k));
  return by_block.transpose() * D * by_block;
}

}  // namespace

Choice::Choice(const TypeModel& t, std::size_t r, const RegionModel& m)
    : type(t),
      model(m),
      region(r),
      p(m.features()),
      q(m.regressors()),
      prior(symmetric_inverse(m.between + m.mean_error)),
      decouple(m.decouple),
      errors(m, r),
      log_determinant(std::log(std::abs(determinant(m.decouple)))),
      lambda_is_uncertain(m.lambda_variance.maxCoeff() > lambda_variance_known) {}

double exceeded_by_chance(const RegionModel& m, double statistic, const Uncertainty& u, double scale_freedom) {
  const auto p = static_cast<double>(m.features());
  const double within = std::max(1 - u.between, 1e-3);
  // Satterthwaite's degrees of freedom of a sum of estimated covariances, f of a relative variance 2 / f, and
  // Hotelling's correction for them: what is known of the variance along a direction, with what lambda leaves open, is
  // taken for what is known of the directions too.
  const double of_covariance =
      1 / (u.by_lambda / 2 + within * within / m.noise_freedom + u.between * u.between / m.between_freedom);
  const double below = of_covariance - p + 1;
  if (below < 2) return 1;
  return fisher_f_above(p, 1 / (within * within / scale_freedom + 1 / below), statistic * below / of_covariance / p);
}

JointSeries::JointSeries(const Choice& c, const Rows& healthy, const Rows& recent)
    : choice_(c),
      own_(c.errors.own(healthy, recent)),
      back_(inverse(own_.turn)),
      prior_(turned(c.prior, back_)),
      healthy_(healthy.size()),
      rows_(healthy.size() + recent.size()) {
  kept_.reserve(rows_), temperature_.reserve(rows_);
  w_.resize(rows_ * static_cast<std::size_t>(c.p)), variance_.resize(w_.size());
  const TypeModel& t = c.type;
  const auto& region = regions[c.region];
  const double middle = (t.temperature_low_degC + t.temperature_high_degC) / 2;
  double day = 0;
  for (std::size_t i = 0; i < rows_; ++i) {
    const Row& row = i < healthy_ ? healthy[i] : recent[i - healthy_];
    const double gap = i > 0 ? std::max(0.0, row.day - day) : 0;
    kept_.push_back(gap == 1 ? c.model.persistence : gap > 0 ? std::pow(c.model.persistence, gap) : 1);
    day = row.day;
    Eigen::Map<Small>(&variance_[i * static_cast<std::size_t>(c.p)], c.p) = c.errors.variance(row, own_.turn);
    temperature_.push_back(t.knows_temperature ? (row.temperature_degC - middle) / temperature_unit_K : 0);
    const double T = temperature_.back();
    Small y = row.logarithmic.segment(region.first, region.count) - T * T * c.model.curvature;
    Small z = c.decouple * y;
    for (Index k = 0; k < c.p; ++k) z(k) -= c.model.mean(k * c.q) + (c.q > 1 ? T * c.model.mean(k * c.q + 1) : 0);
    Eigen::Map<Small>(&w_[i * static_cast<std::size_t>(c.p)], c.p).noalias() = own_.turn * z;
  }
}

JointSeries::Sums JointSeries::sums(Index component, double lambda, Sums* healthy) const {
  Sums out = Sums::Zero();
  Eigen::Vector4d day = Eigen::Vector4d::Zero();
  double variance = lambda;
  for (std::size_t i = 0; i < rows_; ++i) {
    if (i == healthy_ && healthy) *healthy = out;
    const double kept = kept_[i];
    if (i > 0) variance = kept * kept * variance + lambda * (1 - kept * kept), day *= kept;
    const std::size_t at = i * static_cast<std::size_t>(choice_.p) + static_cast<std::size_t>(component);
    const double total = variance + variance_[at], gain = variance / total;
    const Eigen::Vector4d row(1, temperature_[i], i < healthy_ ? 0 : 1, w_[at]);
    const Eigen::Vector4d innovation = row - day;
    out.noalias() += innovation * (innovation / total).transpose();
    day += gain * innovation;
    variance -= gain * variance;
  }
  if (healthy_ == rows_ && healthy) *healthy = out;
  return out;
}

Scale JointSeries::scale() const {
  const RegionModel& m = choice_.model;
  Scale out{.value = m.scale, .freedom = m.scale_freedom};
  const Index q = choice_.q;
  if (static_cast<Index>(healthy_) <= q) return out;
  double squares = 0;
  for (Index k = 0; k < choice_.p; ++k) {
    Sums own;
    sums(k, own_.lambda(k), &own);
    const double constant = own(0, 0), c = own(0, w_column) / constant;
    double rest = own(w_column, w_column) - c * own(0, w_column);
    if (q > 1) {
      const double slope = own(0, 1) / constant, left = own(1, 1) - slope * own(0, 1),
                   z = own(1, w_column) - slope * own(0, w_column);
      if (left > 1e-9 * own(1, 1)) rest -= z * z / left;
    }
    squares += std::max(0.0, rest);
  }
  const auto freedom = static_cast<double>((static_cast<Index>(healthy_) - q) * choice_.p);
  out.value = (m.scale_freedom * m.scale + squares) / (m.scale_freedom + freedom);
  out.freedom += freedom;
  return out;
}

Eigen::VectorXd JointSeries::baseline() const {
  const Scale s = scale();
  const Follower known(*this, s);
  Regression mean(choice_.p * choice_.q);
  for (Index k = 0; k < choice_.p; ++k) {
    auto of_z = mean.segment(k * choice_.q, choice_.q);
    of_z.setZero();
    for (Index l = 0; l < choice_.p; ++l) of_z += back_(k, l) * known.mean().segment(l * choice_.q, choice_.q);
  }
  return choice_.model.mean + Eigen::VectorXd(mean);
}

JointSeries::Solved JointSeries::solve(const std::array<Sums, features_maximum>& sums, double scale) const {
  const Index p = choice_.p, q = choice_.q, n = p * q;
  RegressionMatrix precision = prior_;
  Regression moment(n), to_shift(n);
  Solved out{.covariance = {}, .mean = {}, .shift = Small(p), .variance = SmallMatrix(p, p), .between = {}};
  for (Index k = 0; k < p; ++k) {
    const Sums& S = sums[static_cast<std::size_t>(k)];
    const double own = S(shift_column, shift_column);
    // The shift solved first: what it leaves of the sums for B.
    for (Index i = 0; i < q; ++i) {
      to_shift(k * q + i) = -S(i, shift_column) / own;
      moment(k * q + i) = (S(i, w_column) + to_shift(k * q + i) * S(shift_column, w_column)) / scale;
      for (Index l = 0; l < q; ++l)
        precision(k * q + i, k * q + l) += (S(i, l) + to_shift(k * q + i) * S(shift_column, l)) / scale;
    }
  }
  out.covariance = inverse_of(precision);
  out.mean = out.covariance * moment;
  const RegressionMatrix prior_part = out.covariance * prior_ * out.covariance;
  out.between = SmallMatrix(p, p);
  for (Index k = 0; k < p; ++k) {
    const Sums& S = sums[static_cast<std::size_t>(k)];
    const auto by_k = to_shift.segment(k * q, q);
    out.shift(k) = S(shift_column, w_column) / S(shift_column, shift_column) + by_k.dot(out.mean.segment(k * q, q));
    for (Index l = 0; l < p; ++l) {
      const auto by_l = to_shift.segment(l * q, q);
      out.variance(k, l) = by_k.dot(out.covariance.block(k * q, l * q, q, q) * by_l);
      out.between(k, l) = by_k.dot(prior_part.block(k * q, l * q, q, q) * by_l);
    }
    out.variance(k, k) += scale / S(shift_column, shift_column);
  }
  return out;
}

WindowFit JointSeries::window(const Scale& scale) const {
  const RegionModel& m = choice_.model;
  const Index p = choice_.p;
  std::array<Sums, features_maximum> at;
  for (Index k = 0; k < p; ++k) at[static_cast<std::size_t>(k)] = sums(k, own_.lambda(k), nullptr);
  const Solved s = solve(at, scale.value);
  const Eigen::LLT<SmallMatrix> factor(s.variance);
  WindowFit out{.shift = back_ * s.shift,
                .covariance = back_ * s.variance * back_.transpose(),
                .statistic = s.shift.dot(factor.solve(s.shift))};
  out.uncertainty.between = std::clamp(factor.solve(s.between).trace() / static_cast<double>(p), 0.0, 1.0);
  if (!choice_.lambda_is_uncertain) return out;
  for (Index k = 0; k < p; ++k)
    at[static_cast<std::size_t>(k)] =
        sums(k, own_.lambda(k) * std::exp(lambda_step), nullptr) / std::exp(lambda_step * m.scale_by_lambda(k));
  const Solved other = solve(at, scale.value);
  for (Index k = 0; k < p; ++k) {
    const double effect = (other.variance(k, k) / s.variance(k, k) - 1) / lambda_step;
    out.uncertainty.by_lambda += effect * effect * m.lambda_variance(k) / static_cast<double>(p);
  }
  return out;
}

JointSeries::Follower::Follower(const JointSeries& series, const Scale& scale)
    : series_(series), choice_(series.choice_), scale_(scale) {
  const Index p = choice_.p, q = choice_.q;
  RegressionMatrix precision = series.prior_;
  Regression moment = Regression::Zero(p * q);
  for (auto k = Index{0}; k < p; ++k) day_[static_cast<std::size_t>(k)].variance = series.own_.lambda(k);
  for (; row_ < series.healthy_; ++row_)
    for (Index k = 0; k < p; ++k) {
      const Whitened w = whiten(k, true);
      const std::array x{w.constant, w.temperature};
      for (Index i = 0; i < q; ++i) {
        moment(k * q + i) += x[static_cast<std::size_t>(i)] * w.z / scale.value;
        for (Index l = 0; l < q; ++l)
          precision(k * q + i, k * q + l) +=
              x[static_cast<std::size_t>(i)] * x[static_cast<std::size_t>(l)] / scale.value;
      }
    }
  covariance_ = inverse_of(precision);
  mean_ = covariance_ * moment;
}

JointSeries::Follower::Whitened JointSeries::Follower::whiten(Index component, bool learn) {
  const auto k = static_cast<std::size_t>(component);
  Day& d = day_[k];
  const std::size_t at = row_ * static_cast<std::size_t>(choice_.p) + k;
  const double lambda = series_.own_.lambda(component), kept = series_.kept_[row_], v = series_.variance_[at];
  if (row_ > 0) {
    d.constant *= kept, d.temperature *= kept, d.z *= kept;
    d.variance = kept * kept * d.variance + lambda * (1 - kept * kept);
  }
  const double total = d.variance + v, root = std::sqrt(total), gain = d.variance / total;
  const double constant = 1 - d.constant, temperature = series_.temperature_[row_] - d.temperature,
               z = series_.w_[at] - d.z;
  if (learn) {
    d.constant += gain * constant, d.temperature += gain * temperature, d.z += gain * z;
    d.variance -= gain * d.variance;
  }
  return {
      .constant = constant / root, .temperature = temperature / root, .z = z / root, .day_share = gain, .total = total};
}

JointSeries::Innovation JointSeries::Follower::next(bool learn) {
  const Index p = choice_.p, q = choice_.q;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, features_maximum, regression_maximum> H(p, p * q);
  H.setZero();
  Small e(p), by_lambda(p);
  double log_total = -2 * (choice_.log_determinant + std::log(std::abs(determinant(series_.own_.turn))));
  for (Index k = 0; k < p; ++k) {
    const Whitened w = whiten(k, learn);
    H(k, k * q) = w.constant;
    if (q > 1) H(k, k * q + 1) = w.temperature;
    e(k) = w.z - H.row(k).dot(mean_);
    log_total += std::log(w.total);
    by_lambda(k) = w.day_share + choice_.model.scale_by_lambda(k);
  }
  ++row_;
  const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, regression_maximum, features_maximum> gain =
      covariance_ * H.transpose();
  SmallMatrix F = H * gain;
  F.diagonal().array() += scale_.value;
  const Eigen::LLT<SmallMatrix> factor(F);
  Innovation out{
      .statistic = e.dot(factor.solve(e)), .uncertainty = {}, .log_variance = log_total + std::log(F.determinant())};
  const SmallMatrix between = gain.transpose() * series_.prior_ * gain;
  Uncertainty u{.between = std::clamp(factor.solve(between).trace() / static_cast<double>(p), 0.0, 1.0)};
  const double within = 1 - u.between;
  u.by_lambda =
      within * within * by_lambda.cwiseAbs2().dot(Small(choice_.model.lambda_variance)) / static_cast<double>(p);
  out.uncertainty = u;
  out.by_chance = exceeded_by_chance(choice_.model, out.statistic, u, scale_.freedom);
  if (!learn) return out;
  mean_ += gain * factor.solve(e);
  covariance_ -= gain * factor.solve(SmallMatrix::Identity(p, p)) * gain.transpose();
  covariance_ = ((covariance_ + covariance_.transpose()) / 2).eval();
  return out;
}

void JointSeries::Follower::learn_scale(double statistic) {
  const auto p = static_cast<double>(choice_.p);
  scale_.value *= (scale_.freedom + statistic) / (scale_.freedom + p);
  scale_.freedom += p;
}

}  // namespace tribotwin::twin::diagnosis::fleet
