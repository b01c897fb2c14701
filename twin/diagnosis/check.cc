#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/diagnosis/check.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin::diagnosis {
namespace {

using Problem = std::optional<std::string>;
constexpr double gravity = 9.81;
constexpr double prior_healthy = 0.9;   ///< most joints that are checked are healthy
constexpr double unknown_below = 1e-3;  ///< probability of the misfit that the best pattern leaves

Problem unfit(const HealthyState& h, const ObservationFile& file, const Observation& o) {
  if (!h.joint.empty() && !file.joint.empty() && h.joint != file.joint)
    return fmt::format("{}: is of joint '{}', the healthy state of '{}': learn one for each joint", o.file, file.joint,
                       h.joint);
  if (h.torque_max_nm > 0 && file.torque_max_nm > 0 && std::abs(file.torque_max_nm / h.torque_max_nm - 1) > 1e-3)
    return fmt::format(
        "{}: friction_nm / friction_norm says torque_max {:.4g} Nm, the healthy state was learned with {:.4g} Nm: "
        "another joint or another unit",
        o.file, file.torque_max_nm, h.torque_max_nm);
  if (h.knows_temperature && !o.temperature_degC)
    return fmt::format(
        "{}: has no column temperature_degC, with which the healthy state was learned: record it, or learn without it",
        o.name());
  // Standstill friction at its bound, Coulomb friction, is a result; a curve without slow or fast levels has none.
  for (const Eigen::Index i : {1, 2, 3})
    if (std::ranges::count(o.weak, feature_names[static_cast<std::size_t>(i)]) &&
        !(o.features(i) > 0 && o.shape.isZero() && o.features(0) == o.features(1)))
      return fmt::format(
          "{}: {}: not identifiable from its levels; record the speeds of the healthy curves, from well below the "
          "Stribeck velocity ({:.2g} rad/s, motor side) to well into viscous friction",
          o.name(), joined(o.weak), h.mean(2));
  for (const Eigen::Index i : {1, 2})
    if (const double ratio = o.features(i) / h.mean(i); !(ratio < 20 && ratio > 0.05))
      return fmt::format("{}: {} is {:.4g} {} where {:.4g} is healthy: another joint or another unit", o.name(),
                         feature_names[static_cast<std::size_t>(i)], o.features(i),
                         feature_units[static_cast<std::size_t>(i)], h.mean(i));
  return {};
}

std::string sentence_of(const HealthyState& h, const Observation& o, const Verdict& v) {
  std::string s = o.name() + ": ";
  const std::string where = h.extrapolates(o) ? fmt::format(" Learned were {:.0f} to {:.0f} degC only.",
                                                            h.temperature_low_degC, h.temperature_high_degC)
                                              : "";
  if (!v.anomalous) return s + "healthy: contact surfaces and lubricant are as learned." + where;
  std::vector<std::string> what;
  for (std::size_t r = 0; r < regions.size(); ++r)
    if (v.region[r].anomalous)
      what.push_back(
          fmt::format("{} (T^2 {:.1f}, limit {:.1f})", regions[r].of, v.region[r].statistic, v.region[r].limit));
  for (std::size_t k = 0; k < indicator_count; ++k)
    if (v.indicators[k] && v.indicators[k]->anomalous)
      what.push_back(
          fmt::format("{} ({:.3g}, limit {:.3g})", indicators[k].name, v.indicators[k]->value, v.indicators[k]->limit));
  s += fmt::format("not as learned: {}. ", joined(what));
  if (v.perhaps_healthy)
    s += fmt::format("By chance, more likely than by any known cause (probability {}); repeat the test.",
                     probability_text(v.confidence));
  else if (!v.cause)
    s += "No known cause moves friction like this; repeat the test, then inspect the joint.";
  else
    s += fmt::format("It looks like {} (confidence {}), severity {:.2g} {}; {}.", v.cause->meaning,
                     probability_text(v.confidence), v.severity, v.cause->unit == "1" ? "(relative)" : v.cause->unit,
                     v.cause->advice);
  if (v.region[0].anomalous && v.load.load_norm > 2 * v.load.sigma)
    s += fmt::format(" Its equivalent load is {}; the wear threshold, {}, is {}.", load_text(h, v.load.load_norm),
                     load_text(h, v.load.threshold), v.load.load_norm > v.load.threshold ? "exceeded" : "not reached");
  return s + where;
}

/// One-sided prediction limits of ripple and lost motion.
void judge_indicators(const HealthyState& h, const Observation& o, double false_alarm, Verdict& v) {
  const double n = static_cast<double>(h.observations);
  const double t = student_t_upper_quantile(n - 1, false_alarm) * std::sqrt(1 + 1 / n);
  for (const std::size_t k : {ripple, lost_motion})
    if (h.indicators[k] && o.indicators[k]) {
      v.indicators[k] =
          IndicatorVerdict{.value = *o.indicators[k], .limit = h.indicators[k]->mean + t * h.indicators[k]->deviation};
      v.indicators[k]->anomalous = v.indicators[k]->value > v.indicators[k]->limit;
      v.anomalous |= v.indicators[k]->anomalous;
    }
}

/// The cause of an anomaly. A limit is exceeded by chance, too: `healthy` stays among the candidates.
void find_cause(const HealthyState& h, Verdict& v) {
  const Candidate& best = v.candidates.front();
  const Baseline both_regions{
      .coefficients = {}, .covariance = h.together, .inverse_gram = {}, .freedom = h.degrees_of_freedom()};
  if (const double chance = both_regions.exceeded_by_chance(best.misfit); chance < unknown_below) {
    v.pattern = "unknown";
    v.confidence = 1 - chance;
    return;
  }
  v.confidence = best.probability;
  v.cause = best.pattern;
  v.perhaps_healthy = !v.cause;
  v.pattern = v.cause ? v.cause->name : "unknown";
  v.severity = best.severity;
}

Verdict verdict_of(const HealthyState& h, const Observation& o, const CheckOptions& options) {
  Verdict v;
  for (std::size_t r = 0; r < regions.size(); ++r) {
    v.region[r] = judge(h, o, r, options.false_alarm);
    v.anomalous |= v.region[r].anomalous;
  }
  judge_indicators(h, o, options.false_alarm, v);
  v.load = equivalent_load(h, o);
  v.candidates = candidates(h, o, prior_healthy);
  if (v.anomalous)
    find_cause(h, v);
  else
    v.confidence = std::ranges::find(v.candidates, nullptr, &Candidate::pattern)->probability;
  v.sentence = sentence_of(h, o, v);
  return v;
}

}  // namespace

std::string probability_text(double p) {
  return p > 0.99 ? "> 99 %" : p < 0.01 ? "< 1 %" : fmt::format("{:.0f} %", 100 * p);
}

std::string two_digits(double x) { return std::abs(x) < 99.5 ? fmt::format("{:.2g}", x) : fmt::format("{:.0f}", x); }

std::string load_text(const HealthyState& h, double load_norm) {
  const double nm = load_norm * h.torque_max_nm;
  if (nm > 0 && h.lever_m > 0) return two_digits(nm / (gravity * h.lever_m)) + " kg at the flange";
  return two_digits(nm > 0 ? nm : load_norm) + (nm > 0 ? " Nm" : " of torque_max");
}

RegionVerdict judge(const HealthyState& h, const Observation& o, std::size_t which, double false_alarm) {
  const auto& r = regions[which];
  const Baseline& base = h.region[which];
  const Eigen::VectorXd e = h.deviation(o).segment(r.first, r.count);
  RegionVerdict v{.distance = h.distance(o.features, which)};
  v.beyond_two_sigma = v.distance > h.anomalous_distance;
  v.beyond_wear = v.distance > h.wear_distance;
  v.statistic = e.dot(symmetric_solution(base.covariance, e)) /
                base.variance(h.regressors(o.temperature_degC), h.scatter_of(o, which));
  v.limit = base.limit(false_alarm);
  v.by_chance = base.exceeded_by_chance(v.statistic);
  v.anomalous = v.statistic > v.limit;
  return v;
}

EquivalentLoad equivalent_load(const HealthyState& h, const Observation& o) {
  const Baseline& base = h.region[0];
  const Eigen::Vector3d effect = h.load_effect.head(3), weighted = symmetric_solution(base.covariance, effect);
  const double information = effect.dot(weighted);
  EquivalentLoad l{.threshold = h.wear_load()};
  if (!(information > 0)) return l;
  l.load_norm = h.load_of_term(weighted.dot(h.deviation(o).head(3)) / information);
  const double per_term = 1 + h.sensitivity_at_mean_load() * l.load_norm;  // slope of load_of_term
  l.sigma = per_term * std::sqrt(base.variance(h.regressors(o.temperature_degC), h.scatter_of(o, 0)) / information);
  if (h.torque_max_nm > 0) {
    l.nm = l.load_norm * h.torque_max_nm;
    if (h.lever_m > 0) l.kg = *l.nm / (gravity * h.lever_m);
  }
  return l;
}

Result<std::vector<Verdict>> check(const HealthyState& healthy, const ObservationFile& file,
                                   const CheckOptions& options) {
  std::vector<Verdict> all;
  for (const auto& o : file.observations) {
    if (auto problem = unfit(healthy, file, o)) return tl::unexpected(*problem);
    all.push_back(verdict_of(healthy, o, options));
  }
  return all;
}

}  // namespace tribotwin::twin::diagnosis
