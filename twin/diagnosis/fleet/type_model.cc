#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/diagnosis/fleet/estimates.hpp>
#include <tribotwin/twin/diagnosis/healthy.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/numerics/median.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

constexpr std::size_t scatter_samples = 20000;
constexpr double unknown_variance = 1e6;  ///< of a shift beforehand, in variances of the measurement

/// Temperatures, typical scatter and load.
void learn_conditions(const EachRobot& each, TypeModel& t) {
  bool all_warm = true;
  double load_sum = 0, load_count = 0;
  std::array<std::vector<double>, 2> scatter;
  std::array<bool, 2> claimed{true, true};
  each([&](const Rows& rows) {
    if (rows.empty()) return;
    ++t.robots;
    for (const Row& row : rows) {
      const double T = row.temperature_degC;
      if (!std::isfinite(T)) all_warm = false;
      const bool first = t.observations++ == 0;
      if (std::isfinite(T) && (first || T < t.temperature_low_degC)) t.temperature_low_degC = T;
      if (std::isfinite(T) && (first || T > t.temperature_high_degC)) t.temperature_high_degC = T;
      if (std::isfinite(row.load_norm)) load_sum += row.load_norm, ++load_count;
      for (std::size_t r = 0; r < 2; ++r) {
        claimed[r] = claimed[r] && row.scatter[r] > 0;
        if (scatter[r].size() < scatter_samples) scatter[r].push_back(row.scatter[r]);
      }
    }
  });
  t.knows_temperature = all_warm && t.temperature_high_degC - t.temperature_low_degC >= temperature_span_K;
  if (load_count > 0) t.load_norm = load_sum / load_count;
  for (std::size_t r = 0; r < 2; ++r)
    if (claimed[r] && !scatter[r].empty()) t.region[r].typical_scatter = identification::median_of(scatter[r]);
}

void learn_region(const EachRobot& each, const WithinRobots& within, std::size_t which, TypeModel& t) {
  RegionModel& m = t.region[which];
  m.curvature = within.slopes.row(1).segment(regions[which].first, regions[which].count).transpose();
  learn_noise(each, within, which, t);
  std::vector<RobotSums> sums;
  const auto sum_up = [&] {
    sums.clear();
    each([&](const Rows& rows) {
      if (!rows.empty()) sums.push_back(robot_sums(t, which, rows));
    });
  };
  sum_up();
  decouple_residuals(sums, m);
  sum_up();
  learn_scale(sums, m);
  // With S_n and S_d times s the typical robot has a scale of 1.
  m.decouple /= std::sqrt(m.scale);
  for (auto& s : sums) s.moment /= std::sqrt(m.scale);
  m.scale = 1;
  learn_between(sums, m);
}

}  // namespace

VectorXd TypeModel::regressors(const Row& row) const {
  VectorXd x = VectorXd::Ones(knows_temperature ? 2 : 1);
  const double middle = (temperature_low_degC + temperature_high_degC) / 2;
  if (knows_temperature) x(1) = (row.temperature_degC - middle) / temperature_unit_K;
  return x;
}

VectorXd TypeModel::decoupled(const Row& row, std::size_t which) const {
  const RegionModel& m = region[which];
  VectorXd y = row.logarithmic.segment(regions[which].first, regions[which].count);
  if (knows_temperature) {
    const double t = regressors(row)(1);
    y -= t * t * m.curvature;
  }
  return m.decouple * y;
}

double TypeModel::scatter(const Row& row, std::size_t which) const {
  const double typical = region[which].typical_scatter;
  return typical > 0 && row.scatter[which] > 0 ? row.scatter[which] / typical : 1;
}

Spread spread_of(const TypeModel& type) {
  const RegionModel& m = type.region[0];
  const Index q = m.regressors();
  const VectorXd back = inverse(m.decouple).row(0);  // ln Fc of z
  VectorXd level = VectorXd::Zero(m.mean.size());
  for (Index k = 0; k < m.features(); ++k) level(k * q) = back(k);
  return {.between = std::sqrt(level.dot(m.between * level)),
          .days = std::sqrt(back.cwiseAbs2().dot(m.lambda)),
          .measurement = back.norm()};
}

MatrixXd whiten(const RegionModel& m, Index component, std::span<const double> days, std::span<const double> scatter,
                const MatrixXd& columns, double* log_variance) {
  MatrixXd out(columns.rows(), columns.cols());
  const double lambda = m.lambda(component);
  Eigen::RowVectorXd state = Eigen::RowVectorXd::Zero(columns.cols());
  double variance = lambda;
  for (Index i = 0; i < columns.rows(); ++i) {
    const auto at = static_cast<std::size_t>(i);
    if (i > 0) {
      const double gap = std::max(0.0, days[at] - days[at - 1]), kept = gap > 0 ? std::pow(m.persistence, gap) : 1;
      state *= kept;
      variance = kept * kept * variance + lambda * (1 - kept * kept);
    }
    const double total = variance + scatter[at];
    if (log_variance) *log_variance += std::log(total);
    const Eigen::RowVectorXd innovation = columns.row(i) - state;
    out.row(i) = innovation / std::sqrt(total);
    state += variance / total * innovation;
    variance *= scatter[at] / total;
  }
  return out;
}

Result<TypeModel> learn_type(const EachRobot& each) {
  TypeModel t;
  learn_conditions(each, t);
  const WithinRobots within = within_robots(each, t.knows_temperature);
  if (within.freedom < static_cast<double>(observations_minimum))
    return tl::unexpected(Error(fmt::format(
        "{} curve(s) of {} robot(s): the scatter from curve to curve needs {} or more beyond the first of each robot; "
        "record some robots repeatedly, on different days, cold to hot",
        t.observations, t.robots, observations_minimum)));
  if (!(within.residual.diagonal().minCoeff() > 1e-18))
    return tl::unexpected(
        Error(fmt::format("the {} curves of {} robot(s) do not scatter: they are copies of each other, and do not show "
                          "the normal scatter",
                          t.observations, t.robots)));
  t.within = within.covariance;
  for (std::size_t r = 0; r < regions.size(); ++r) learn_region(each, within, r, t);
  if (t.robots < robots_minimum)
    t.notes.push_back(
        fmt::format("{} robots are too few to borrow from each other; {} or more do", t.robots, robots_minimum));
  if (!t.knows_temperature)
    t.notes.emplace_back(
        "the curves span less than 5 K or have no temperature_degC: effects of temperature cannot be separated from "
        "faults");
  return t;
}

JointBaseline robot_scale(const TypeModel& type, std::size_t region, const Rows& healthy) {
  const RegionModel& m = type.region[region];
  JointBaseline out{
      .mean = m.mean, .covariance = m.between + m.mean_error, .scale = m.scale, .freedom = m.scale_freedom};
  if (healthy.empty()) return out;
  const RobotSums sums = robot_sums(type, region, healthy);
  out.scale = (m.scale_freedom * m.scale + sums.squares) / (m.scale_freedom + sums.freedom);
  out.freedom = m.scale_freedom + sums.freedom;
  return out;
}

double exceeded_by_chance(const RegionModel& m, double statistic, const Shares& share, double scale_freedom) {
  const auto p = static_cast<double>(m.features());
  const double within = std::max(1 - share.between, 1e-3), of_scale = scale_freedom / (within * within);
  // Satterthwaite's degrees of freedom of a sum of estimated covariances, and Hotelling's correction for them: a
  // relative variance of 2 / f has f degrees of freedom.
  const double by_lambda =
      (share.day.array() + within * m.scale_by_lambda.array()).square().cwiseProduct(m.lambda_variance.array()).mean();
  // Twice the variance of the variances: the directions of S_n and S_d are estimates as well.
  const double of_covariance =
      1 / (by_lambda + within * within / m.noise_freedom + share.between * share.between / m.between_freedom);
  const double below = of_covariance - p + 1;
  // Twice here too: the likelihood of phi takes the directions as known.
  const double by_persistence = (share.window ? 1 : 0.5) * within * within * m.persistence_variance;
  if (below < 2) return 1;
  return fisher_f_above(p, 1 / (1 / of_scale + 1 / below + by_persistence), statistic * below / of_covariance / p);
}

JointFilter::JointFilter(const TypeModel& t, std::size_t r, const JointBaseline& s) : type_(t), region_(r), scale_(s) {
  const Index p = model_.features(), n = p + b_;
  state_ = VectorXd::Zero(n);
  state_.tail(b_) = scale_.mean;
  covariance_ = MatrixXd::Zero(n, n);
  covariance_.diagonal().head(p) = scale_.scale * model_.lambda;
  covariance_.bottomRightCorner(b_, b_) = scale_.covariance;
}

void JointFilter::begin_shift() {
  const Index n = state_.size(), p = model_.features();
  state_.conservativeResize(n + p);
  covariance_.conservativeResize(n + p, n + p);
  state_.tail(p).setZero();
  covariance_.rightCols(p).setZero(), covariance_.bottomRows(p).setZero();
  covariance_.diagonal().tail(p).setConstant(unknown_variance);
}

void JointFilter::advance(double day) {
  const Index p = model_.features();
  const double gap = begun_ ? std::max(0.0, day - day_) : 0, kept = gap > 0 ? std::pow(model_.persistence, gap) : 1;
  day_ = day, begun_ = true;
  if (kept == 1) return;
  state_.head(p) *= kept;
  covariance_.topRows(p) *= kept;
  covariance_.leftCols(p) *= kept;
  covariance_.diagonal().head(p) += (1 - kept * kept) * scale_.scale * model_.lambda;
}

/// What an observation shows of the state.
MatrixXd JointFilter::seen(const Row& row) const {
  const Index p = model_.features(), q = model_.regressors();
  MatrixXd H = MatrixXd::Zero(p, state_.size());
  const VectorXd x = type_.regressors(row);
  for (Index k = 0; k < p; ++k) {
    H(k, k) = 1;
    H.row(k).segment(p + k * q, q) = x.transpose();
    if (state_.size() > p + b_) H(k, p + b_ + k) = 1;
  }
  return H;
}

JointFilter::Innovation JointFilter::take(const Row& row, bool learn) {
  const Index p = model_.features();
  const double v = type_.scatter(row, region_);
  advance(row.day);
  const MatrixXd H = seen(row);
  const VectorXd e = type_.decoupled(row, region_) - H * state_;
  const MatrixXd PH = covariance_ * H.transpose();
  MatrixXd F = H * PH;
  F.diagonal().array() += v * scale_.scale;
  const MatrixXd inverse_F = symmetric_inverse(F);
  const Eigen::ArrayXd total = F.diagonal().array(), day = covariance_.diagonal().head(p).array() / total;
  Innovation out{.statistic = e.dot(inverse_F * e)};
  const double between = (1 - day - v * scale_.scale / total).mean();
  out.by_chance = exceeded_by_chance(model_, out.statistic,
                                     {.day = day.matrix(), .between = std::clamp(between, 0.0, 1.0)}, scale_.freedom);
  if (!learn) return out;
  const MatrixXd gain = PH * inverse_F;
  state_ += gain * e;
  covariance_ -= gain * PH.transpose();
  covariance_ = ((covariance_ + covariance_.transpose()) / 2).eval();
  return out;
}

void JointFilter::learn_scale(double statistic) {
  const auto p = static_cast<double>(model_.features());
  const double next = (scale_.freedom * scale_.scale + statistic * scale_.scale) / (scale_.freedom + p);
  scale_.scale = next, scale_.freedom += p;
}

JointBaseline JointFilter::baseline() const {
  const Index p = model_.features();
  return {.mean = state_.segment(p, b_),
          .covariance = covariance_.block(p, p, b_, b_),
          .scale = scale_.scale,
          .freedom = scale_.freedom};
}

JointBaseline JointFilter::shift() const {
  const Index p = model_.features();
  return {.mean = state_.tail(p),
          .covariance = covariance_.bottomRightCorner(p, p),
          .scale = scale_.scale,
          .freedom = scale_.freedom};
}

}  // namespace tribotwin::twin::diagnosis::fleet
