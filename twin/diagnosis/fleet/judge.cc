#include <algorithm>
#include <cmath>

#include <tribotwin/twin/diagnosis/fleet/estimates.hpp>
#include <tribotwin/twin/diagnosis/fleet/judge.hpp>
#include <tribotwin/twin/diagnosis/patterns.hpp>
#include <tribotwin/twin/diagnosis/sequence.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

constexpr double score_maximum = 8;     ///< normal scores are limited to this
constexpr double unknown_below = 1e-3;  ///< probability of the misfit that the best pattern leaves
constexpr double prior_healthy = 0.9;   ///< cancels: only the causes are compared

/// The joint's filter after its healthy rows.
JointFilter filter_of(const TypeModel& type, std::size_t region, const Rows& healthy) {
  JointFilter filter(type, region, robot_scale(type, region, healthy));
  for (const Row& row : healthy) filter.take(row);
  return filter;
}

/// Roughly, what the variance of a window's mean consists of.
Shares shares_of(const TypeModel& type, std::size_t region, const JointBaseline& shift, const Rows& recent) {
  const RegionModel& m = type.region[region];
  const MatrixXd ones = MatrixXd::Ones(static_cast<Index>(recent.size()), 1);
  std::vector<double> days, scatter;
  double information = 0;
  for (const Row& row : recent) {
    days.push_back(row.day), scatter.push_back(type.scatter(row, region));
    information += 1 / scatter.back();
  }
  Shares out{.day = VectorXd(m.features()), .window = true};
  const auto p = static_cast<double>(m.features());
  for (Index k = 0; k < m.features(); ++k) {
    const double total = shift.covariance(k, k), noise = shift.scale / information,
                 with_day = shift.scale / whiten(m, k, days, scatter, ones).squaredNorm();
    out.day(k) = std::clamp((with_day - noise) / total, 0.0, 1.0);
    out.between += std::clamp((total - with_day) / total, 0.0, 1.0) / p;
  }
  return out;
}

/// The joint's own healthy state in the form in which one joint's patterns are found.
HealthyState state_of(const TypeModel& type, const Rows& healthy, const Shift& shift, double load_sensitivity) {
  HealthyState h{.joint = type.joint, .observations = type.observations, .load_sensitivity = load_sensitivity};
  h.knows_temperature = type.knows_temperature;
  h.temperature_low_degC = type.temperature_low_degC, h.temperature_high_degC = type.temperature_high_degC;
  h.together.setZero();
  for (std::size_t r = 0; r < regions.size(); ++r) {
    const RegionModel& m = type.region[r];
    const Index p = m.features(), q = m.regressors();
    const JointBaseline base = filter_of(type, r, healthy).baseline();
    MatrixXd z(q, p);  // per component, in units of x
    for (Index k = 0; k < p; ++k) z.col(k) = base.mean.segment(k * q, q);
    Baseline& b = h.region[r];
    b.coefficients = z * inverse(m.decouple).transpose();
    if (q > 1) b.coefficients.row(1) /= temperature_unit_K;
    b.covariance = shift.covariance[r];
    b.inverse_gram = MatrixXd::Zero(q, q);
    b.freedom = shift.freedom;
    h.together.block(regions[r].first, regions[r].first, p, p) = shift.covariance[r];
  }
  Features middle;
  middle << h.region[0].coefficients.row(0).transpose(), h.region[1].coefficients.row(0).transpose();
  h.mean = middle;
  h.mean.head(4) = middle.head(4).array().exp();
  Features unit = h.mean;
  unit(4) = 1;
  h.covariance = unit.asDiagonal() * type.within * unit.asDiagonal();
  if (std::isfinite(type.load_norm))
    h.indicators[load] =
        HealthyState::IndicatorState{.mean = type.load_norm, .deviation = 0.01 * type.load_norm + 1e-3};
  h.load_effect.head(2).setConstant(h.sensitivity_at_mean_load());
  return h;
}

}  // namespace

Shift judge_window(const TypeModel& type, const Rows& healthy, const Rows& recent) {
  Shift out{.observations = recent.size()};
  const auto n = static_cast<double>(recent.size());
  double load_sum = 0;
  for (const Row& row : recent) out.temperature_degC += row.temperature_degC / n, load_sum += row.load_norm;
  out.load_norm = load_sum / n;
  for (std::size_t r = 0; r < regions.size(); ++r) {
    const RegionModel& m = type.region[r];
    JointFilter filter = filter_of(type, r, healthy);
    filter.begin_shift();
    for (const Row& row : recent) filter.take(row);
    const JointBaseline shift = filter.shift();
    const double statistic = shift.mean.dot(symmetric_solution(shift.covariance, shift.mean));
    out.by_chance[r] = exceeded_by_chance(m, statistic, shares_of(type, r, shift, recent), shift.freedom);
    const MatrixXd back = inverse(m.decouple);
    out.mean[r] = back * shift.mean;
    out.covariance[r] = back * shift.covariance * back.transpose();
    out.freedom = std::min(out.freedom, shift.freedom);
  }
  out.p = std::min(1.0, 2 * std::min(out.by_chance[0], out.by_chance[1]));
  return out;
}

Finding explain(const TypeModel& type, const Rows& healthy, const Shift& shift, double load_sensitivity) {
  const HealthyState h = state_of(type, healthy, shift, load_sensitivity);
  Observation o;
  if (std::isfinite(shift.temperature_degC)) o.temperature_degC = shift.temperature_degC;
  if (std::isfinite(shift.load_norm)) o.indicators[load] = shift.load_norm;
  const Eigen::VectorXd x = h.regressors(o.temperature_degC);
  Features y;
  y << h.region[0].predicted(x) + shift.mean[0], h.region[1].predicted(x) + shift.mean[1];
  o.features = y;
  o.features.head(4) = y.head(4).array().exp();
  Finding out{.friction_change = std::expm1(shift.mean[0](0)), .load = equivalent_load(h, o)};
  out.margin = out.load.threshold - out.load.load_norm;
  const double reach = student_t_quantile(shift.freedom, 0.975) * out.load.sigma;
  out.margin_low = out.margin - reach, out.margin_high = out.margin + reach;
  auto causes = candidates(h, o, prior_healthy);
  std::erase_if(causes, [](const Candidate& c) { return !c.pattern; });
  double sum = 0;
  for (const auto& c : causes) sum += c.probability;
  const Candidate& best = causes.front();
  const Baseline both{.coefficients = {}, .covariance = h.together, .inverse_gram = {}, .freedom = shift.freedom};
  if (const double chance = both.exceeded_by_chance(best.misfit); chance < unknown_below || !(sum > 0)) {
    out.confidence = 1 - chance;
    return out;
  }
  out.pattern = best.pattern->name, out.unit = best.pattern->unit, out.advice = best.pattern->advice;
  out.severity = best.severity, out.confidence = best.probability / sum;
  return out;
}

Chart watch_joint(const TypeModel& type, const Rows& healthy, const Rows& recent, const CusumTail& tail,
                  double stop_learning) {
  std::array<JointFilter, 2> filters{filter_of(type, 0, healthy), filter_of(type, 1, healthy)};
  Chart out;
  std::array<double, 2> sum{};
  bool learn = true;
  for (const Row& row : recent) {
    Chart::Step step{.day = row.day};
    for (std::size_t r = 0; r < regions.size(); ++r) {
      const auto [statistic, chance] = filters[r].take(row, learn);
      if (learn) filters[r].learn_scale(statistic);
      const double score =
          chance > 0 ? std::clamp(-normal_quantile(std::min(chance, 1 - 1e-15)), -score_maximum, score_maximum)
                     : score_maximum;
      sum[r] = std::max(0.0, sum[r] + score - cusum_allowance);
      step.p = std::min(step.p, 2 * tail(out.steps.size() + 1, sum[r]));
    }
    step.sum = sum;
    learn = learn && step.p > stop_learning;
    out.steps.push_back(step);
  }
  return out;
}

}  // namespace tribotwin::twin::diagnosis::fleet
