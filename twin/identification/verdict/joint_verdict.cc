#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>

#include <tribotwin/twin/identification/verdict/joint_verdict.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/distributions.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index;

constexpr Index fewest_samples = 20;
/// Pieces of a shorter record are no longer than what residuals correlate over anyway.
constexpr double shortest_drift_s = 40;

/// A joint in motion: its samples one behind the other, with what the residual may depend on.
struct Course {
  std::vector<Index> sample;     ///< of the recording
  std::vector<std::size_t> run;  ///< stretch without a break
  std::vector<double> residual;
};

Course course_of(const JointMotion& motion, const Eigen::MatrixXd& predicted, Index joint) {
  Course c;
  std::size_t run = 0;
  for (const auto& [first, last] : motion.segments) {
    ++run;
    for (Index i = first; i < last; ++i) {
      const double r = motion.torque(joint, i) - predicted(joint, i);
      if (!motion.moving(joint, i) || !std::isfinite(r)) {
        ++run;
        continue;
      }
      c.sample.push_back(i), c.run.push_back(run), c.residual.push_back(r);
    }
  }
  return c;
}

/// Sums of residuals in the bins of one quantity, by visit.
class Bins {
 public:
  /// `count` bins of as many samples each. `blocks`: visits also end after this many samples; 0: never.
  Bins(const std::vector<double>& x, const std::vector<double>& y, const std::vector<std::size_t>& run,
       std::size_t count, std::size_t block)
      : sums_(count) {
    std::vector<double> sorted = x;
    std::ranges::sort(sorted);
    for (std::size_t b = 0; b <= count; ++b) edges_.push_back(sorted[b * (sorted.size() - 1) / count]);
    std::size_t before = count, length = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      const auto above = std::upper_bound(edges_.begin() + 1, edges_.end() - 1, x[i]);
      const auto b = static_cast<std::size_t>(above - edges_.begin()) - 1;
      if (b != before || run[i] != run[i - 1] || (block && length >= block)) close(before), length = 0;
      visit_sum_ += y[i], ++visit_count_, ++length;
      before = b;
    }
    close(before);
  }

  double visits() const {
    double n = 0;
    for (const Sums& s : sums_) n += s.visits;
    return n;
  }
  bool enough() const {
    return std::ranges::all_of(sums_, [](const Sums& s) { return s.visits >= 2; }) &&
           visits() >= 3 * static_cast<double>(sums_.size());
  }

  /// `squares`: of all residuals; `mean`: theirs.
  Dependence dependence(std::string on, double mean, double squares) const {
    Dependence d{.on = std::move(on), .bins = {}};
    const auto count = static_cast<double>(sums_.size());
    double between = 0, within = 0;
    for (const Sums& s : sums_) between += s.samples * std::pow(s.mean() - mean, 2), within += s.within();
    const double freedom = visits() - count, noise = within / freedom;
    d.share = std::clamp((between - (count - 1) * noise) / std::max(1e-300, squares), 0.0, 1.0);
    d.chance = noise > 0 ? fisher_f_above(count - 1, freedom, between / (count - 1) / noise) : 0;
    double xx = 0, yy = 0, xy = 0;
    for (std::size_t b = 0; b < sums_.size(); ++b) {
      const Sums& s = sums_[b];
      d.bins.push_back({edges_[b], edges_[b + 1], s.mean(), std::sqrt(noise / s.samples)});
      const double x = static_cast<double>(b) - (count - 1) / 2, y = s.mean() - mean;
      xx += x * x, yy += y * y, xy += x * y;
    }
    d.growth = yy > 0 ? xy / std::sqrt(xx * yy) : 0;
    return d;
  }

 private:
  struct Sums {
    double samples = 0, sum = 0, visits = 0, squared_means = 0;  ///< the last weighted by the visits' samples
    double mean() const { return samples > 0 ? sum / samples : 0; }
    double within() const { return std::max(0.0, squared_means - samples * mean() * mean()); }
  };

  void close(std::size_t bin) {
    if (visit_count_ == 0) return;
    Sums& s = sums_[bin];
    s.samples += visit_count_, s.sum += visit_sum_, ++s.visits;
    s.squared_means += visit_sum_ * visit_sum_ / visit_count_;
    visit_sum_ = visit_count_ = 0;
  }

  std::vector<double> edges_;
  std::vector<Sums> sums_;
  double visit_sum_ = 0, visit_count_ = 0;
};

/// In as many bins as visits allow; nothing where not even four can be told. `in_blocks`: of what drifts with time, in
/// four bins, whose visits are pieces of equal length.
Dependence examined(std::string on, const std::vector<double>& x, const std::vector<double>& y,
                    const std::vector<std::size_t>& run, bool in_blocks, double length_s = 0) {
  const auto n = static_cast<double>(y.size());
  const double mean = std::reduce(y.begin(), y.end()) / n,
               squares = std::inner_product(y.begin(), y.end(), y.begin(), 0.0);
  const auto [low, high] = std::ranges::minmax(x);
  if (!(high - low > 1e-9 * (1 + std::abs(high)))) return {.on = std::move(on), .bins = {}};
  const std::vector<std::size_t> unbroken(run.size(), 0);
  for (const std::size_t count : {16u, 8u, 4u}) {
    if (y.size() < 6 * count || (in_blocks && (count > 4 || length_s < shortest_drift_s))) continue;
    const Bins bins(x, y, in_blocks ? unbroken : run, count, in_blocks ? y.size() / count / 6 : 0);
    if (bins.enough()) return bins.dependence(std::move(on), mean, squares);
  }
  return {.on = std::move(on), .bins = {}};
}

std::vector<Dependence> dependence_of(const JointMotion& motion, const Eigen::MatrixXd& gear_load, Index joint,
                                      const Course& c, double period_s) {
  const double length_s = period_s * static_cast<double>(c.sample.size());
  const auto of = [&](const Eigen::MatrixXd& all) {
    std::vector<double> x;
    for (const Index i : c.sample) x.push_back(all(joint, i));
    return x;
  };
  const std::vector<double> speed = of(motion.qd);
  std::vector<double> load = of(gear_load), time_s(c.sample.size()), against = c.residual;
  for (std::size_t k = 0; k < c.sample.size(); ++k) {
    load[k] = std::abs(load[k]);
    time_s[k] = period_s * static_cast<double>(c.sample[k]);  // files follow each other
    against[k] *= speed[k] < 0 ? -1 : 1;                      // as friction does
  }
  std::vector<Dependence> all{examined("speed", speed, c.residual, c.run, false),
                              examined("load", load, against, c.run, false),
                              examined("position", of(motion.q), c.residual, c.run, false),
                              examined("time", time_s, c.residual, c.run, true, length_s)};
  if (motion.has_temperature)
    all.push_back(examined("temperature", of(motion.temperature_degC), against, c.run, true, length_s));
  return all;
}

/// Haar's octaves: the mean squares of differences between neighbouring means of 1, 2, 4, ... samples add up to the
/// mean square of the residual. Stretches that are shorter than such a pair do not count for it.
void add_spectrum(const Course& c, double period_s, double cutoff_hz, JointVerdict& v) {
  const double mean_square = v.rms * v.rms;
  double rest = 1, share_above = 0;
  v.white_half_hz = 0.5 * cutoff_hz;
  std::vector<double> sums = c.residual;
  std::vector<std::size_t> run = c.run;
  double to_hz = 0.5 / period_s;
  for (double m = 1; m < 1e6; m *= 2, to_hz /= 2) {
    std::vector<double> next;
    std::vector<std::size_t> next_run;
    double squares = 0;
    for (std::size_t i = 0; i + 1 < sums.size();) {
      if (run[i] != run[i + 1]) {
        ++i;
        continue;
      }
      squares += std::pow(sums[i] - sums[i + 1], 2) / (2 * m);
      next.push_back(sums[i] + sums[i + 1]), next_run.push_back(run[i]);
      i += 2;
    }
    if (next.size() < 8) break;
    const double share = std::min(rest, squares / static_cast<double>(next.size()) / (2 * m) / mean_square);
    v.octaves.push_back({to_hz / 2, to_hz, share});
    rest -= share;
    sums = std::move(next), run = std::move(next_run);
  }
  v.octaves.push_back({0, v.octaves.empty() ? to_hz : v.octaves.back().from_hz, rest});
  for (const Octave& o : v.octaves) {
    v.half_below_hz = o.to_hz;
    if (share_above + o.share >= 0.5) {
      const double within = o.share > 0 ? (0.5 - share_above) / o.share : 0;
      v.half_below_hz = o.from_hz > 0 ? o.to_hz * std::pow(o.from_hz / o.to_hz, within) : o.to_hz;
      break;
    }
    share_above += o.share;
  }
}

/// Motors that turn with other joints carry their friction: wrists, differentials.
void add_other_joints(const Regressor& regressor, const JointMotion& motion, Index joint, const Course& c,
                      std::vector<Dependence>& all) {
  for (Index other = 0; other < regressor.joints(); ++other) {
    if (other == joint) continue;
    std::vector<double> speed;
    for (const Index i : c.sample) speed.push_back(motion.qd(other, i));
    Dependence d = examined("speed of " + regressor.joint_name(other), speed, c.residual, c.run, false);
    if (d.shown()) all.push_back(std::move(d));
  }
}

JointVerdict verdict_of(const Regressor& regressor, const JointMotion& motion, const Eigen::MatrixXd& predicted,
                        const Eigen::MatrixXd& gear_load, Index joint) {
  JointVerdict v{.joint = regressor.joint_name(joint), .dependence = {}, .octaves = {}};
  const Course c = course_of(motion, predicted, joint);
  v.samples = static_cast<Index>(c.sample.size());
  if (v.samples < fewest_samples) return v;
  double squares = 0, torque = 0, sum = 0;
  for (std::size_t k = 0; k < c.sample.size(); ++k)
    squares += c.residual[k] * c.residual[k], torque += std::pow(motion.torque(joint, c.sample[k]), 2),
        sum += motion.torque(joint, c.sample[k]);
  v.rms = std::sqrt(squares / static_cast<double>(v.samples));
  v.relative_error = torque > 0 ? std::sqrt(squares / torque) : 0;
  const double variation = torque - sum * sum / static_cast<double>(v.samples);
  v.of_variation = variation > 0 ? std::sqrt(squares / variation) : 0;
  if (!(v.rms > 0)) return v;
  const auto& [first, last] = motion.segments.front();
  const double period_s = last - first > 1 ? motion.time_s[static_cast<std::size_t>(first) + 1] -
                                                 motion.time_s[static_cast<std::size_t>(first)]
                                           : motion.period_s;
  v.dependence = dependence_of(motion, gear_load, joint, c, period_s);
  if (v.badly_explained()) add_other_joints(regressor, motion, joint, c, v.dependence);
  add_spectrum(c, period_s, motion.cutoff_hz, v);
  return v;
}

/// What would help.
std::string words_of(const Dependence& d) {
  const auto share = fmt::format("{:.0f} % of it", 100 * d.share);
  if (d.on == "speed") return fmt::format("changes with speed ({}): another law or asymmetry would help", share);
  if (d.on == "load")
    return fmt::format("{} with load ({}): a law with load would help", d.growth > 0.7 ? "grows" : "changes", share);
  if (d.on == "position")
    return fmt::format("repeats with position ({}): gravity, a spring or a ripple that the model lacks", share);
  if (d.on == "time") return fmt::format("drifts with time ({}): record temperatures, or take one session", share);
  if (d.on == "temperature") return fmt::format("changes with temperature ({}): a law with it would help", share);
  return fmt::format("changes with the {} ({}): their motors may be coupled", d.on, share);
}

std::string sentence(const JointVerdict& v) {
  std::vector<const Dependence*> shown;
  for (const Dependence& d : v.dependence)
    if (d.shown()) shown.push_back(&d);
  std::ranges::sort(shown, std::ranges::greater{}, [](const Dependence* d) { return d->share; });
  std::vector<std::string> parts;
  for (const Dependence* d : shown) parts.push_back(words_of(*d));
  if (std::ranges::all_of(v.dependence, [](const Dependence& d) { return d.bins.empty(); }))
    parts.push_back("is recorded too briefly to say what it depends on");
  else if (parts.empty())
    parts.push_back(fmt::format(
        "follows none of speed, load, position and time that could be examined; half of it is below {:.2g} Hz (of "
        "white noise: {:.2g} Hz)",
        v.half_below_hz, v.white_half_hz));
  return fmt::format("joint {}: {:.0f} % of its torque's variation is unexplained{}; the residual {}", v.joint,
                     100 * v.of_variation, v.of_variation > 0.7 ? " (is its torque dead, or all offset?)" : "",
                     joined(parts, "; it "));
}

}  // namespace

std::vector<JointVerdict> judge_joints(const Regressor& regressor, const JointMotion& motion,
                                       const Eigen::MatrixXd& predicted, const Eigen::MatrixXd& gear_load) {
  std::vector<JointVerdict> all;
  for (Index j = 0; j < regressor.joints(); ++j) all.push_back(verdict_of(regressor, motion, predicted, gear_load, j));
  return all;
}

std::vector<std::string> warnings_of(std::span<const JointVerdict> all) {
  std::vector<std::string> lines;
  for (const auto& v : all)
    if (v.badly_explained()) lines.push_back(sentence(v));
  return lines;
}

std::vector<std::string> badly_explained(std::span<const JointVerdict> all) {
  std::vector<std::string> names;
  for (const auto& v : all)
    if (v.badly_explained()) names.push_back(v.joint);
  return names;
}

}  // namespace tribotwin::twin::identification
