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

/// Student's distribution of several numbers, at a T^2.
double log_student(double p, double freedom, double log_variance, double statistic) {
  return std::lgamma((freedom + p) / 2) - std::lgamma(freedom / 2) - p / 2 * std::log(freedom * std::numbers::pi) -
         log_variance / 2 - (freedom + p) / 2 * std::log1p(statistic / freedom);
}

constexpr double lowest_factor = -0.4, factor_step = 0.1;  ///< logarithms
constexpr double factor_deviation = 0.2;    ///< of the logarithm, beforehand: the model is taken for true to so much
constexpr double improbable_factor = 0.01;  ///< relative to a factor of 1

/// ln of the density relative to that of a factor of 1.
double log_density_of_factor(std::size_t i, const RegionModel& m, WeightsOf what) {
  const double extrapolated = what == WeightsOf::shifts ? factor_deviation * factor_deviation : 0;
  return -0.5 * log_factor(i) * log_factor(i) / (extrapolated + 2 / m.noise_freedom);
}

}  // namespace

double log_factor(std::size_t i) { return lowest_factor + factor_step * static_cast<double>(i); }

std::vector<std::size_t> factors_of(const RegionModel& m, WeightsOf what) {
  std::vector<std::size_t> all;
  for (std::size_t i = 0; i < factor_count; ++i)
    if (what == WeightsOf::shifts || log_density_of_factor(i, m, what) > std::log(improbable_factor)) all.push_back(i);
  return all;
}

double log_prior_of_factor(std::size_t i, const RegionModel& m, WeightsOf what) {
  double sum = 0;
  for (const std::size_t k : factors_of(m, what)) sum += std::exp(log_density_of_factor(k, m, what));
  return log_density_of_factor(i, m, what) - std::log(sum);
}

PersistenceWeights::PersistenceWeights(const TypeModel& type, WeightsOf what) {
  for (std::size_t r = 0; r < regions.size(); ++r)
    for (std::size_t k = 0; k < type.choices(r); ++k) {
      const RegionModel& m = type.choice(r, k);
      for (const std::size_t i : factors_of(m, what))
        log_[r].emplace_back().fill(std::log(m.probability) + log_prior_of_factor(i, m, what));
    }
}

void PersistenceWeights::add(const Evidence& joint) {
  for (std::size_t r = 0; r < regions.size(); ++r)
    for (std::size_t k = 0; k < log_[r].size(); ++k) {
      auto sum = log_[r][k].begin();
      const double healthy = joint.healthy[r][k];
      for (const double other : joint.other[r]) {
        const double larger = std::max(healthy, other), of_healthy = std::exp(healthy - larger),
                     of_other = std::exp(other - larger);
        for (const double share : others_shares)
          *sum++ += larger + std::log((1 - share) * of_healthy + share * of_other);
      }
    }
}

ByChoice PersistenceWeights::weights() const {
  ByChoice out;
  for (std::size_t r = 0; r < regions.size(); ++r) {
    double highest = -std::numeric_limits<double>::infinity(), sum = 0;
    for (const auto& of_choice : log_[r]) highest = std::max(highest, std::ranges::max(of_choice));
    for (const auto& of_choice : log_[r]) {
      double w = 0;
      for (const double x : of_choice) w += std::exp(x - highest);
      out[r].push_back(w), sum += w;
    }
    for (double& w : out[r]) w /= sum;
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
      for (std::size_t i = 0; i < others_variances.size(); ++i)
        out.evidence.other[r][i] = log_student(p, scale.freedom, log_variance + p * std::log(others_variances[i]),
                                               fit.statistic / others_variances[i]);
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

namespace {

/// The CUSUMs of a region under one persistence, one for each factor.
class Charts {
 public:
  Charts(const Choice& choice, const CusumTail& tail)
      : choice_(choice), tail_(tail), factors_(factors_of(choice.model, WeightsOf::charts)) {
    sum_.assign(factors_.size(), 0);
    density = sum_;
  }

  std::vector<double> density;  ///< log, by factor
  std::array<double, others_variances.size()> other{};

  /// Appends p of the step `i` of every factor to `p`; sum and p of a factor of 1.
  std::pair<double, double> take(const JointSeries::Innovation& now, double scale_freedom, std::size_t i,
                                 std::vector<double>& p) {
    const auto features = static_cast<double>(choice_.p);
    std::pair<double, double> of_one;
    for (std::size_t k = 0; k < factors_.size(); ++k) {
      const double factor = log_factor(factors_[k]);
      const bool one = std::abs(factor) < factor_step / 2;
      const double statistic = one ? now.statistic : now.statistic / std::exp(factor);
      const double chance =
          one ? now.by_chance : exceeded_by_chance(choice_.model, statistic, now.uncertainty, scale_freedom);
      density[k] += log_student(features, scale_freedom, now.log_variance + features * factor, statistic);
      sum_[k] = std::max(0.0, sum_[k] + score(chance) - cusum_allowance);
      p.push_back(tail_(i + 1, sum_[k]));
      if (one) of_one = {sum_[k], p.back()};
    }
    for (std::size_t k = 0; k < others_variances.size(); ++k)
      other[k] += log_student(features, scale_freedom, now.log_variance + features * std::log(others_variances[k]),
                              now.statistic / others_variances[k]);
    return of_one;
  }

 private:
  static double score(double chance) {
    if (!(chance > 0)) return score_maximum;
    return std::clamp(-normal_quantile(std::min(chance, 1 - 1e-15)), -score_maximum, score_maximum);
  }

  const Choice& choice_;
  const CusumTail& tail_;
  const std::vector<std::size_t> factors_;
  std::vector<double> sum_;
};

}  // namespace

Chart Judge::watch(const Rows& healthy, const Rows& recent, const CusumTail& tail, double stop_learning) const {
  Chart out;
  for (const Row& row : recent) out.steps.push_back({.day = row.day, .p = {}});
  for (std::size_t r = 0; r < regions.size(); ++r)
    for (const Choice& c : region_[r].choices) {
      const bool first = &c == &region_[r].choices.front();
      const JointSeries series(c, healthy, recent);
      JointSeries::Follower follower(series, series.scale());
      Charts charts(c, tail);
      bool learn = true;
      for (std::size_t i = 0; i < recent.size(); ++i) {
        const auto now = follower.next(learn);
        const auto [sum, beyond] = charts.take(now, follower.scale().freedom, i, out.steps[i].p[r]);
        if (learn) follower.learn_scale(now.statistic);
        if (first) out.steps[i].sum = std::max(out.steps[i].sum, sum);
        learn = learn && 2 * beyond > stop_learning;
      }
      auto& evidence = out.evidence.healthy[r];
      evidence.insert(evidence.end(), charts.density.begin(), charts.density.end());
      if (first) out.evidence.other[r] = charts.other;
    }
  return out;
}

}  // namespace tribotwin::twin::diagnosis::fleet
