#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include <fmt/format.h>

#include <tribotwin/twin/identification/dynamics_choice/repetitions.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

/// Mean square of what positions differ by after so many samples, over twice their variance in these samples, of the
/// joint that repeats worst. 1 for what does not repeat, and for joints that only rest at either end of a stretch.
class Difference {
 public:
  explicit Difference(const Eigen::Ref<const MatrixXd>& q) : q_(q.colwise() - q.rowwise().mean()) {
    for (Index j = 0; j < q_.rows(); ++j)
      if (q_.row(j).squaredNorm() > least_variance * static_cast<double>(q_.cols())) moving_.push_back(j);
  }
  /// Up to `enough` where it is not less.
  double operator()(Index lag, double enough = 1e300) const {
    constexpr Index looks = 1000;
    const Index count = q_.cols() - lag, every = std::max<Index>(1, count / looks);
    double worst = 0;
    for (std::size_t k = 0; k < moving_.size() && worst < enough; ++k) {
      double differences = 0, sum = 0, squares = 0, n = 0;
      for (Index i = 0; i < count; i += every, ++n) {
        const double q = q_(moving_[k], i);
        differences += std::pow(q_(moving_[k], i + lag) - q, 2), sum += q, squares += q * q;
      }
      const double variance = (squares - sum * sum / n) / n;
      worst = std::max(worst, variance > least_variance ? differences / (2 * variance * n) : 1.0);
    }
    return worst;
  }
  bool moves() const { return !moving_.empty(); }

 private:
  static constexpr double least_variance = 1e-10;

  MatrixXd q_;
  std::vector<Index> moving_;
};

/// In samples, not whole; none where nothing repeats.
std::optional<double> period_of(const Eigen::Ref<const MatrixXd>& q) {
  constexpr double different = 0.1, same = 1e-3, longest = 0.8;
  const Difference difference(q);
  const auto last = static_cast<Index>(longest * static_cast<double>(q.cols()));
  Index lag = 1;
  while (difference.moves() && lag < last && difference(lag, different) < different) ++lag;
  while (lag < last && difference(lag, same) >= same) ++lag;
  if (!difference.moves() || lag >= last) return {};
  while (lag + 1 < last && difference(lag + 1) < difference(lag)) ++lag;
  const double before = difference(lag - 1), at = difference(lag), after = difference(lag + 1);
  const double bend = before - 2 * at + after;
  return static_cast<double>(lag) + (bend > 0 ? std::clamp((before - after) / (2 * bend), -0.5, 0.5) : 0);
}

/// The smallest change of a joint's recorded position: the step of its encoder, where that is coarse.
double step_of(const RobotRecording& rec, Index joint) {
  double step = std::numeric_limits<double>::infinity();
  for (Index i = 1; i < rec.position.cols(); ++i)
    if (const double change = std::abs(rec.position(joint, i) - rec.position(joint, i - 1)); change > 1e-12)
      step = std::min(step, change);
  return step;
}

/// Root mean square of what recorded positions differ by so much later.
double repeated_within(const RobotRecording& rec, Index joint, double later_s) {
  double sum = 0, count = 0;
  std::size_t later = 0;
  for (std::size_t i = 0; i < rec.time_s.size(); ++i) {
    const double wanted = rec.time_s[i] + later_s;
    while (later + 1 < rec.time_s.size() &&
           std::abs(rec.time_s[later + 1] - wanted) <= std::abs(rec.time_s[later] - wanted))
      ++later;
    if (wanted > rec.time_s.back()) break;
    sum += std::pow(rec.position(joint, static_cast<Index>(later)) - rec.position(joint, static_cast<Index>(i)), 2);
    ++count;
  }
  return count > 0 ? std::sqrt(sum / count) : 0;
}

/// A joint whose encoder's errors repeat.
struct Alike {
  Index joint;
  double within, step;
};

std::optional<Alike> alike_after(const RobotRecording& rec, double later_s) {
  constexpr double alike = 0.45;  // of a step: that far apart its errors are no longer correlated
  for (Index j = 0; j < rec.position.rows(); ++j) {
    const double step = step_of(rec, j), within = repeated_within(rec, j, later_s);
    if (std::isfinite(step) && within < alike * step) return Alike{j, within, step};
  }
  return {};
}

/// How many periods later, 1 .. most, the encoder's errors are others. Sampling may meet the period after two of them.
Result<std::vector<Index>> turns_with_other_errors(const RobotRecording& rec, const Regressor& regressor,
                                                   double period_s, Index most) {
  std::vector<Index> out;
  for (Index k = 1; k <= most; ++k)
    if (!alike_after(rec, static_cast<double>(k) * period_s)) out.push_back(k);
  if (!out.empty()) return out;
  const Alike found = *alike_after(rec, period_s);
  return tl::unexpected(Error(fmt::format(
      "{}: joint {} repeats its positions within {:.2g} of its encoder's step ({:.3g}): the encoder's errors "
      "repeat as well, and repetitions do not tell them from motion; use least squares with a lower cut-off",
      rec.file.string(), regressor.joint_name(found.joint), found.within / found.step, found.step)));
}

/// Other repetitions of a sample in a stretch [first, last).
struct Others {
  Index first, last;
  double period;             ///< samples
  std::vector<Index> turns;  ///< how many periods off they are, either way

  /// Not whole.
  std::vector<double> of(Index i) const {
    std::vector<double> out;
    for (const Index k : turns)
      for (const double off : {-static_cast<double>(k) * period, static_cast<double>(k) * period})
        if (const double at = static_cast<double>(i) + off;
            at >= static_cast<double>(first) && at < static_cast<double>(last - 1))
          out.push_back(at);
    return out;
  }
};

/// Mean of the columns at these places, linear between them: a period is not a whole number of samples.
VectorXd mean_at(const MatrixXd& signal, const std::vector<double>& places) {
  VectorXd out = VectorXd::Zero(signal.rows());
  for (const double at : places) {
    const auto before = static_cast<Index>(at);
    const double share = at - static_cast<double>(before);
    out += (1 - share) * signal.col(before) + share * signal.col(before + 1);
  }
  return out / static_cast<double>(places.size());
}

/// Instruments of a stretch; returns how many groups it has.
Index fill(const Others& others, JointMotion& motion, Instruments& out) {
  constexpr Index wanted = 48, shortest = 20;
  const Index groups = std::min(wanted, static_cast<Index>(others.period) / shortest);
  for (Index i = others.first; i < others.last; ++i) {
    const double turns = static_cast<double>(i - others.first) / others.period;
    const auto group = static_cast<Index>((turns - std::floor(turns)) * static_cast<double>(groups));
    out.group[static_cast<std::size_t>(i)] = out.groups + std::min(group, groups - 1);
    const std::vector<double> at = others.of(i);
    if (at.empty()) {
      motion.moving.col(i).setConstant(false);
      continue;
    }
    out.motion.q.col(i) = mean_at(motion.q, at);
    out.motion.qd.col(i) = mean_at(motion.qd, at);
    out.motion.qdd.col(i) = mean_at(motion.qdd, at);
    out.motion.direction.col(i) = mean_at(motion.direction, at);
  }
  return groups;
}

}  // namespace

Result<Instruments> instruments_of_repetitions(std::span<const RobotRecording> recordings, const Regressor& regressor,
                                               JointMotion& motion) {
  constexpr Index fewest = 8;
  Instruments out{.motion = motion, .group = std::vector<Index>(motion.time_s.size(), 0), .groups = 0, .notes = {}};
  for (std::size_t s = 0; s < motion.segments.size(); ++s) {
    const auto& [first, last] = motion.segments[s];
    const RobotRecording& rec = recordings[motion.file[s]];
    const auto period = period_of(motion.q.middleCols(first, last - first));
    if (!period) {
      motion.moving.middleCols(first, last - first).setConstant(false);
      out.notes.push_back(fmt::format("{}: no motion repeats from {:.4g} to {:.4g} s; not used", rec.file.string(),
                                      motion.time_s[static_cast<std::size_t>(first)],
                                      motion.time_s[static_cast<std::size_t>(last - 1)]));
      continue;
    }
    const double sample_s =
        motion.time_s[static_cast<std::size_t>(first) + 1] - motion.time_s[static_cast<std::size_t>(first)];
    const double length = static_cast<double>(last - first) / *period;
    const auto most = static_cast<Index>(length);
    auto turns = turns_with_other_errors(rec, regressor, *period * sample_s, std::max<Index>(1, most));
    if (!turns) return tl::unexpected(turns.error());
    const bool all = static_cast<Index>(turns->size()) >= most;
    const Index groups = fill({first, last, *period, *std::move(turns)}, motion, out);
    if (groups < fewest)
      return tl::unexpected(
          Error(fmt::format("{}: repeats every {:.4g} s, {:.0f} samples; instrumental variables need {} for their "
                            "sigmas: repeat a longer motion, or keep more samples (a wider --cutoff)",
                            rec.file.string(), *period * sample_s, *period, fewest * 20)));
    out.groups += groups;
    out.notes.push_back(
        fmt::format("{}: estimates by instrumental variables: each sample's are the mean of its other repetitions, "
                    "{:.3g} times every {:.5g} s{}",
                    rec.file.string(), length, *period * sample_s,
                    all ? "" : ", without those in which the encoder's errors are the same"));
  }
  if (out.groups == 0)
    return tl::unexpected(Error(fmt::format(
        "{}: no motion is repeated; instrumental variables need one that is, at least one and a quarter times",
        recordings.front().file.string())));
  out.motion.moving = motion.moving;
  return out;
}

}  // namespace tribotwin::twin::identification
