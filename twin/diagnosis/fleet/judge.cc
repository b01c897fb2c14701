#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

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
constexpr double not_healthy = 0.1;     ///< share of joints that is allowed for where persistences are compared
constexpr double others_variance = 25;  ///< of the shifts of those, relative to a healthy joint's

/// Student's distribution of several numbers, at a T^2.
double log_student(double p, double freedom, double log_variance, double statistic) {
  return std::lgamma((freedom + p) / 2) - std::lgamma(freedom / 2) - p / 2 * std::log(freedom * std::numbers::pi) -
         log_variance / 2 - (freedom + p) / 2 * std::log1p(statistic / freedom);
}

constexpr double lowest_factor = -0.4, factor_step = 0.1;  ///< logarithms
constexpr double factor_deviation = 0.2;  ///< of the logarithm, beforehand: the model is taken for true to so much

}  // namespace

double log_factor(std::size_t i) { return lowest_factor + factor_step * static_cast<double>(i); }

double log_prior_of_factor(std::size_t i, const RegionModel& m) {
  const auto density = [&](std::size_t k) {
    return -0.5 * log_factor(k) * log_factor(k) / (factor_deviation * factor_deviation + 2 / m.noise_freedom);
  };
  double sum = 0;
  for (std::size_t k = 0; k < factor_count; ++k) sum += std::exp(density(k));
  return density(i) - std::log(sum);
}

PersistenceWeights::PersistenceWeights(const TypeModel& type, WeightsOf what) {
  const bool factors = what == WeightsOf::shifts;
  for (std::size_t r = 0; r < regions.size(); ++r)
    for (std::size_t k = 0; k < type.choices(r); ++k) {
      const RegionModel& m = type.choice(r, k);
      for (std::size_t i = 0; i < (factors ? factor_count : 1); ++i)
        log_[r].push_back(std::log(m.probability) + (factors ? log_prior_of_factor(i, m) : 0));
    }
}

void PersistenceWeights::add(const Evidence& joint) {
  for (std::size_t r = 0; r < regions.size(); ++r)
    for (std::size_t k = 0; k < log_[r].size(); ++k) {
      const double healthy = joint.healthy[r][k], other = joint.other[r];
      const double larger = std::max(healthy, other);
      log_[r][k] +=
          larger + std::log((1 - not_healthy) * std::exp(healthy - larger) + not_healthy * std::exp(other - larger));
    }
}

ByChoice PersistenceWeights::weights() const {
  ByChoice out = log_;
  for (auto& w : out) {
    const double highest = std::ranges::max(w);
    double sum = 0;
    for (double& x : w) sum += x = std::exp(x - highest);
    for (double& x : w) x /= sum;
  }
  return out;
}

double by_chance(const ByChoice& p, const ByChoice& weights) {
  double smaller = 1;
  for (std::size_t r = 0; r < regions.size(); ++r)
    smaller = std::min(smaller, std::inner_product(p[r].begin(), p[r].end(), weights[r].begin(), 0.0));
  return std::min(1.0, 2 * smaller);
}

Judge::Judge(const TypeModel& type) : type_(type) {
  for (std::size_t r = 0; r < regions.size(); ++r) {
    for (std::size_t k = 0; k < type.choices(r); ++k) region_[r].choices.emplace_back(type, r, type.choice(r, k));
    region_[r].back = inverse(type.region[r].decouple);
  }
}

Shift Judge::shift(const Rows& healthy, const Rows& recent) const {
  Shift out{.observations = recent.size()};
  const auto n = static_cast<double>(recent.size());
  double load_sum = 0;
  for (const Row& row : recent) out.temperature_degC += row.temperature_degC / n, load_sum += row.load_norm;
  out.load_norm = load_sum / n;
  for (std::size_t r = 0; r < regions.size(); ++r) {
    const Region& region = region_[r];
    for (const Choice& c : region.choices) {
      const JointSeries series(c, healthy, recent);
      const Scale scale = series.scale();
      const WindowFit fit = series.window(scale);
      const auto p = static_cast<double>(c.p);
      const double log_variance = std::log(fit.covariance.determinant()) - 2 * c.log_determinant;
      for (std::size_t i = 0; i < factor_count; ++i) {
        const double statistic = fit.statistic / std::exp(log_factor(i));
        out.by_chance[r].push_back(exceeded_by_chance(c.model, statistic, fit.uncertainty, scale.freedom));
        out.evidence.healthy[r].push_back(log_student(p, scale.freedom, log_variance + p * log_factor(i), statistic));
      }
      if (&c != &region.choices.front()) continue;
      out.evidence.other[r] =
          log_student(p, scale.freedom, log_variance + p * std::log(others_variance), fit.statistic / others_variance);
      out.mean[r] = region.back * fit.shift;
      out.covariance[r] = region.back * fit.covariance * region.back.transpose();
      out.freedom = std::min(out.freedom, scale.freedom);
    }
  }
  return out;
}

HealthyState Judge::state_of(const Rows& healthy, const Shift& shift, double load_sensitivity) const {
  const TypeModel& type = type_;
  HealthyState h{.joint = type.joint, .observations = type.observations, .load_sensitivity = load_sensitivity};
  h.knows_temperature = type.knows_temperature;
  h.temperature_low_degC = type.temperature_low_degC, h.temperature_high_degC = type.temperature_high_degC;
  h.together.setZero();
  for (std::size_t r = 0; r < regions.size(); ++r) {
    const Index p = type.region[r].features(), q = type.region[r].regressors();
    const VectorXd base = JointSeries(region_[r].choices.front(), healthy, {}).baseline();
    MatrixXd z(q, p);  // per component, in units of x
    for (Index k = 0; k < p; ++k) z.col(k) = base.segment(k * q, q);
    Baseline& b = h.region[r];
    b.coefficients = z * region_[r].back.transpose();
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

Finding Judge::explain(const Rows& healthy, const Shift& shift, double load_sensitivity) const {
  const HealthyState h = state_of(healthy, shift, load_sensitivity);
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

Chart Judge::watch(const Rows& healthy, const Rows& recent, const CusumTail& tail, double stop_learning) const {
  Chart out;
  for (const Row& row : recent) out.steps.push_back({.day = row.day, .p = {}});
  for (std::size_t r = 0; r < regions.size(); ++r)
    for (const Choice& c : region_[r].choices) {
      const JointSeries series(c, healthy, recent);
      JointSeries::Follower follower(series, series.scale());
      const auto p = static_cast<double>(c.p);
      double sum = 0, density = 0, other = 0;
      bool learn = true;
      for (std::size_t i = 0; i < recent.size(); ++i) {
        const auto [statistic, chance, log_variance] = follower.next(learn);
        const double freedom = follower.scale().freedom;
        density += log_student(p, freedom, log_variance, statistic);
        other += log_student(p, freedom, log_variance + p * std::log(others_variance), statistic / others_variance);
        if (learn) follower.learn_scale(statistic);
        const double score =
            chance > 0 ? std::clamp(-normal_quantile(std::min(chance, 1 - 1e-15)), -score_maximum, score_maximum)
                       : score_maximum;
        sum = std::max(0.0, sum + score - cusum_allowance);
        Chart::Step& step = out.steps[i];
        const double beyond = tail(i + 1, sum);
        step.p[r].push_back(beyond);
        if (&c == &region_[r].choices.front()) step.sum = std::max(step.sum, sum);
        learn = learn && 2 * beyond > stop_learning;
      }
      out.evidence.healthy[r].push_back(density);
      if (&c == &region_[r].choices.front()) out.evidence.other[r] = other;
    }
  return out;
}

}  // namespace tribotwin::twin::diagnosis::fleet
