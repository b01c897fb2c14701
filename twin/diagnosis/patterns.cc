#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <tribotwin/twin/diagnosis/patterns.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/numerics/search.hpp>

namespace tribotwin::twin::diagnosis {
namespace {

constexpr int severities = 400;  // features may be identified to 1 % together, which needs equally fine steps
constexpr double load_ratio_minimum = 0.02, load_ratio_maximum = 1.5;  ///< of ln load_norm, with a payload

Features change(double Fc, double Fs, double Vs, double Fv, double beta = 0) {
  return (Features() << Fc, Fs, Vs, Fv, beta).finished();
}

/// The joint is s [K] warmer than measured or than learned. Without measured temperatures the largest axis of the
/// healthy scatter stands for temperature, in the direction of falling Fv.
Footprint temperature(const HealthyState& h, double s) {
  if (h.knows_temperature) {
    Features slope;
    slope << h.region[0].coefficients.row(1).transpose(), h.region[1].coefficients.row(1).transpose();
    return {.features = s * slope};
  }
  const SymmetricEigen axes = symmetric_eigen(h.together);
  const Features axis = axes.vectors.col(feature_count - 1) * std::sqrt(axes.values(feature_count - 1));
  return {.features = (axis(3) < 0 ? s : -s) / 10 * axis};
}

constexpr double s_minimum = 0.02, s_maximum = 2, loss_maximum = 0.8;
using drive::Fault;

Pattern of_fault(Fault fault, std::string_view meaning, std::string_view advice, double minimum, double maximum,
                 std::string_view unit, Footprint (*footprint)(const HealthyState&, double),
                 bool (*possible)(const HealthyState&, const Observation&) = nullptr) {
  return {.name = drive::info(fault).name,
          .fault = fault,
          .meaning = meaning,
          .advice = advice,
          .minimum = minimum,
          .maximum = maximum,
          .unit = unit,
          .footprint = footprint,
          .possible = possible};
}

/// The indicator was learned and observed.
template <Indicator which>
bool has(const HealthyState& h, const Observation& o) {
  return h.indicators[which] && o.indicators[which];
}

/// Temperature is a possible cause where it is unknown or outside the learned range.
bool outside_learned_temperatures(const HealthyState& h, const Observation& o) {
  return !h.knows_temperature || h.extrapolates(o);
}

/// Filled at the first call, as the names come from another file's table.
const auto& table() {  // long: a table
  static const std::array all{
      Pattern{.name = "temperature",
              .fault = {},
              .meaning = "a temperature outside those the healthy state was learned at",
              .advice = "no fault: learn the healthy state with curves at this temperature too",
              .minimum = 5,
              .maximum = 60,
              .unit = "K",
              .footprint = temperature,
              .possible = outside_learned_temperatures,
              .both_signs = true},
      Pattern{.name = "load",
              .fault = {},
              .meaning = "more load on the joint than in the healthy curves",
              .advice = "check the payload and the balance of the arm; if nothing hangs on it, treat it as wear",
              .minimum = s_minimum,
              .maximum = 1,
              .unit = "of torque_max",
              .footprint =
                  [](const HealthyState& h, double s) {
                    return Footprint{.features = h.load_term(s) * h.load_effect, .load_free = true};
                  }},
      of_fault(Fault::wear, "worn contact surfaces",
               "inspect gear and bearings, look for metal in the lubricant, and repeat the test more often", s_minimum,
               s_maximum, "1",
               [](const HealthyState&, double s) {
                 return Footprint{.features = change(std::log1p(s), std::log1p(s), std::log1p(s), 0)};
               }),
      of_fault(Fault::thickening, "lubricant that has become too stiff (aged, or the wrong one)", "renew the lubricant",
               s_minimum, s_maximum, "1",
               [](const HealthyState&, double s) {
                 return Footprint{.features = change(0, 0, std::log1p(s / 3), std::log1p(s))};
               }),
      of_fault(Fault::lubricant_loss, "loss of lubricant", "look for leaks and refill the lubricant", s_minimum,
               loss_maximum, "1",
               [](const HealthyState&, double s) {
                 return Footprint{.features = change(0, 0, std::log1p(s), std::log1p(-s))};
               }),
      of_fault(Fault::preload_loss, "lost preload of gear or bearings",
               "check and renew the preload of gear and bearings", s_minimum, loss_maximum, "1",
               [](const HealthyState&, double s) {
                 return Footprint{.features = change(std::log1p(-s), std::log1p(-s), 0, 0)};
               }),
      of_fault(
          Fault::backlash, "backlash", "measure the backlash at the flange; adjust or exchange the gear", 1e-6, 0.1,
          "rad", [](const HealthyState&, double s) { return Footprint{.lost_motion_rad = s}; }, has<lost_motion>),
      of_fault(
          Fault::pitted_bearing, "a pitted bearing or tooth: torque repeats with the joint's angle",
          "listen to the joint at low speed; exchange the bearing", 1e-3, 1, "of Fs",
          [](const HealthyState& h, double s) { return Footprint{.ripple_nm = s * h.mean(1)}; }, has<ripple>),
      of_fault(Fault::torque_constant,
               "a motor whose torque constant has dropped, so that torque computed from current is too high",
               "check the motor's magnets and temperature, and the current sensors", s_minimum, loss_maximum, "1",
               [](const HealthyState&, double s) {
                 return Footprint{.features = change(-std::log1p(-s), -std::log1p(-s), 0, -std::log1p(-s)),
                                  .load_factor = 1 / (1 - s)};
               }),
  };
  return all;
}

/// Log of Student's density.
double log_student(double x, double scale, double freedom) {
  const double t = x / scale;
  return std::lgamma((freedom + 1) / 2) - std::lgamma(freedom / 2) - 0.5 * std::log(freedom * std::numbers::pi) -
         std::log(scale) - (freedom + 1) / 2 * std::log1p(t * t / freedom);
}

class Likelihood {
 public:
  Likelihood(const HealthyState& h, const Observation& o)
      : h_(h), o_(o), deviation_(h.deviation(o)), factor_(h.together.llt()) {
    const Eigen::VectorXd x = h.regressors(o.temperature_degC);
    scale_.head(3).setConstant(std::sqrt(h.region[0].variance(x, h.scatter_of(o, 0))));
    scale_.tail(2).setConstant(std::sqrt(h.region[1].variance(x, h.scatter_of(o, 1))));
  }

  double misfit(const Footprint& f) const {
    const Features e = (deviation_ - f.features).cwiseQuotient(scale_);
    return e.dot(factor_.solve(e));
  }

  double log_density(const Footprint& f) const {
    const double freedom = h_.degrees_of_freedom();
    double sum = -(freedom + 1) / 2 * std::log1p(misfit(f) / freedom);
    const double n = static_cast<double>(h_.observations), widening = std::sqrt(1 + 1 / n);
    for (const auto& [which, added] : {std::pair{ripple, f.ripple_nm}, {lost_motion, f.lost_motion_rad}})
      if (h_.indicators[which] && o_.indicators[which])
        sum += log_student(*o_.indicators[which] - h_.indicators[which]->mean - added,
                           h_.indicators[which]->deviation * widening, n - 1);
    if (h_.indicators[load] && o_.indicators[load] && h_.indicators[load]->mean > 0.01 && *o_.indicators[load] > 0) {
      const double mean = h_.indicators[load]->mean, ratio = std::log(*o_.indicators[load] / mean);
      // Near the healthy load the density of a payload is small but not 0: other loads may hide it.
      if (f.load_free)
        sum += std::log(ratio > load_ratio_minimum && ratio < load_ratio_maximum
                            ? 1 / (load_ratio_maximum - load_ratio_minimum)
                            : 1e-6);
      else
        sum += log_student(ratio - std::log(f.load_factor), h_.indicators[load]->deviation / mean * widening, n - 1);
    }
    return sum;
  }

 private:
  const HealthyState& h_;
  const Observation& o_;
  Features deviation_, scale_;
  Eigen::LLT<FeatureMatrix> factor_;
};

/// The severity of maximum likelihood, and the log of the likelihood averaged over all severities.
struct Explanation {
  Candidate candidate;
  double evidence;
};

Explanation explained(const Pattern& p, const HealthyState& h, const Likelihood& likelihood) {
  const auto density = [&](double s) { return likelihood.log_density(p.footprint(h, s)); };
  Candidate best{.pattern = &p};
  std::vector<double> logs;
  double maximum = 0;
  for (const double sign : p.both_signs ? std::vector{1.0, -1.0} : std::vector{1.0})
    for (int i = 0; i < severities; ++i) {
      const double s = sign * p.minimum * std::pow(p.maximum / p.minimum, i / (severities - 1.0));
      logs.push_back(density(s));
      if (logs.size() == 1 || logs.back() > maximum) maximum = logs.back(), best.severity = s;
    }
  // Between its neighbours on the grid.
  const double step = std::pow(p.maximum / p.minimum, 1 / (severities - 1.0));
  const auto [low, high] = std::minmax({best.severity / step, best.severity * step});
  best.severity = golden_section(density, low, high, 1e-4 * (high - low));
  best.misfit = likelihood.misfit(p.footprint(h, best.severity));
  double mean = 0;
  for (const double l : logs) mean += std::exp(l - maximum) / static_cast<double>(logs.size());
  return {best, maximum + std::log(mean)};
}

}  // namespace

std::span<const Pattern> patterns() { return table(); }

std::vector<Candidate> candidates(const HealthyState& h, const Observation& o, double prior_healthy) {
  const Likelihood likelihood(h, o);
  std::vector<Candidate> all{{.misfit = likelihood.misfit({})}};
  std::vector<double> evidence{likelihood.log_density({})};
  for (const Pattern& p : patterns()) {
    if (p.possible && !p.possible(h, o)) continue;
    const Explanation one = explained(p, h, likelihood);
    evidence.push_back(one.evidence);
    all.push_back(one.candidate);
  }
  const double maximum = std::ranges::max(evidence);
  double sum = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const double prior = i == 0 ? prior_healthy : (1 - prior_healthy) / static_cast<double>(all.size() - 1);
    sum += all[i].probability = prior * std::exp(evidence[i] - maximum);
  }
  for (auto& c : all) c.probability /= sum;
  std::ranges::stable_sort(all, std::greater{}, &Candidate::probability);
  return all;
}

}  // namespace tribotwin::twin::diagnosis
