#include <algorithm>
#include <cmath>
#include <numbers>

#include <tribotwin/twin/diagnosis/patterns.hpp>

namespace tribotwin::twin::diagnosis {
namespace {

constexpr int severities = 400;  // features that are known together to 1 % ask for steps as fine
constexpr double outside_K = 2;  ///< beyond the learned temperatures, from where temperature itself is a suspect
constexpr double load_ratio_least = 0.02, load_ratio_most = 1.5;  ///< of ln load_norm, with a payload

Features change(double Fc, double Fs, double Vs, double Fv, double beta = 0) {
  return (Features() << Fc, Fs, Vs, Fv, beta).finished();
}

/// Of a temperature s [K] further on than the thermometer or the learned range says; without thermometer along the
/// largest axis of the healthy scatter, which is that of temperature, towards falling Fv.
Footprint temperature(const HealthyState& h, double s) {
  if (h.knows_temperature) {
    Features slope;
    slope << h.region[0].coefficients.row(1).transpose(), h.region[1].coefficients.row(1).transpose();
    return {.features = s * slope};
  }
  const Eigen::SelfAdjointEigenSolver<FeatureMatrix> axes(h.together);
  const Features axis = axes.eigenvectors().col(feature_count - 1) * std::sqrt(axes.eigenvalues()(feature_count - 1));
  return {.features = (axis(3) < 0 ? s : -s) / 10 * axis};
}

constexpr double s_least = 0.02, s_most = 2, loss_most = 0.8;
const Pattern table[] = {
    {"temperature", "a temperature outside those the healthy state was learned at",
     "no fault: learn the healthy state with curves at this temperature too", 5, 60, "K", temperature},
    {"load", "more load on the joint than in the healthy curves",
     "check the payload and the balance of the arm; if nothing hangs on it, treat it as wear", s_least, 1,
     "of torque_max",
     [](const HealthyState& h, double s) {
       return Footprint{.features = h.load_term(s) * h.load_effect, .load_free = true};
     }},
    {"wear", "worn contact surfaces",
     "inspect gear and bearings, look for metal in the lubricant, and repeat the test more often", s_least, s_most, "1",
     [](const HealthyState&, double s) {
       return Footprint{.features = change(std::log1p(s), std::log1p(s), std::log1p(s), 0)};
     }},
    {"thickening", "lubricant that has become too stiff (aged, or the wrong one)", "renew the lubricant", s_least,
     s_most, "1",
     [](const HealthyState&, double s) {
       return Footprint{.features = change(0, 0, std::log1p(s / 3), std::log1p(s))};
     }},
    {"lubricant_loss", "loss of lubricant", "look for leaks and refill the lubricant", s_least, loss_most, "1",
     [](const HealthyState&, double s) { return Footprint{.features = change(0, 0, std::log1p(s), std::log1p(-s))}; }},
    {"preload_loss", "lost preload of gear or bearings", "check and renew the preload of gear and bearings", s_least,
     loss_most, "1",
     [](const HealthyState&, double s) { return Footprint{.features = change(std::log1p(-s), std::log1p(-s), 0, 0)}; }},
    {"backlash", "backlash", "measure the backlash at the flange; adjust or exchange the gear", 1e-6, 0.1, "rad",
     [](const HealthyState&, double s) { return Footprint{.lost_motion_rad = s}; }},
    {"pitted_bearing", "a pitted bearing or tooth: torque repeats with the joint's angle",
     "listen to the joint at low speed; exchange the bearing", 1e-3, 1, "of Fs",
     [](const HealthyState& h, double s) { return Footprint{.ripple_nm = s * h.mean(1)}; }},
    {"torque_constant", "a motor whose torque constant has dropped, so that torque computed from current is too high",
     "check the motor's magnets and temperature, and the current sensors", s_least, loss_most, "1",
     [](const HealthyState&, double s) {
       return Footprint{.features = change(-std::log1p(-s), -std::log1p(-s), 0, -std::log1p(-s)),
                        .load_factor = 1 / (1 - s)};
     }},
};

/// Student's, of a value that was predicted from n observations.
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
      // Near the healthy load a payload is foretold with next to no density, not none: other loads may hide it.
      if (f.load_free)
        sum += std::log(ratio > load_ratio_least && ratio < load_ratio_most ? 1 / (load_ratio_most - load_ratio_least)
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

bool suspect(const Pattern& p, const HealthyState& h, const Observation& o) {
  if (p.name == "backlash") return h.indicators[lost_motion] && o.indicators[lost_motion];
  if (p.name == "pitted_bearing") return h.indicators[ripple] && o.indicators[ripple];
  if (p.name == "temperature")
    return !h.knows_temperature || *o.temperature_degC < h.temperature_low_degC - outside_K ||
           *o.temperature_degC > h.temperature_high_degC + outside_K;
  return true;
}

}  // namespace

std::span<const Pattern> patterns() { return table; }

std::vector<Candidate> candidates(const HealthyState& h, const Observation& o, double prior_healthy) {
  const Likelihood likelihood(h, o);
  std::vector<Candidate> all{{.misfit = likelihood.misfit({})}};
  std::vector<double> evidence{likelihood.log_density({})};
  for (const Pattern& p : table) {
    if (!suspect(p, h, o)) continue;
    Candidate best{.pattern = &p};
    std::vector<double> logs;
    double most = 0;
    for (const double sign : p.name == "temperature" ? std::vector{1.0, -1.0} : std::vector{1.0})
      for (int i = 0; i < severities; ++i) {
        const double s = sign * p.least * std::pow(p.most / p.least, i / (severities - 1.0));
        logs.push_back(likelihood.log_density(p.footprint(h, s)));
        if (logs.size() == 1 || logs.back() > most) most = logs.back(), best.severity = s;
      }
    // Between its neighbours on the grid, by golden section.
    const double step = std::pow(p.most / p.least, 1 / (severities - 1.0)), golden = std::numbers::phi - 1;
    double low = best.severity / step, high = best.severity * step;
    for (int i = 0; i < 20; ++i) {
      const double a = high - golden * (high - low), b = low + golden * (high - low);
      if (likelihood.log_density(p.footprint(h, a)) < likelihood.log_density(p.footprint(h, b)))
        low = a;
      else
        high = b;
    }
    best.severity = (low + high) / 2;
    best.misfit = likelihood.misfit(p.footprint(h, best.severity));
    double mean = 0;
    for (const double l : logs) mean += std::exp(l - most) / static_cast<double>(logs.size());
    evidence.push_back(most + std::log(mean));
    all.push_back(best);
  }
  const double most = std::ranges::max(evidence);
  double sum = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const double prior = i == 0 ? prior_healthy : (1 - prior_healthy) / static_cast<double>(all.size() - 1);
    sum += all[i].probability = prior * std::exp(evidence[i] - most);
  }
  for (auto& c : all) c.probability /= sum;
  std::ranges::stable_sort(all, std::greater{}, &Candidate::probability);
  return all;
}

}  // namespace tribotwin::twin::diagnosis
