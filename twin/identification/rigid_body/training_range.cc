#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/identification/rigid_body/training_range.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd;

constexpr bool of_all_joints(Ranged what) { return what == Ranged::position || what == Ranged::acceleration; }

double value_of(const JointMotion& motion, const MatrixXd& gear_load, Ranged what, Index joint, Index sample) {
  switch (what) {
    case Ranged::position:
      return motion.q(joint, sample);
    case Ranged::speed:
      return motion.qd(joint, sample);
    case Ranged::acceleration:
      return motion.qdd(joint, sample);
    case Ranged::load:
      return std::abs(gear_load(joint, sample));
    case Ranged::temperature:
      return motion.temperature_degC(joint, sample);
  }
  return 0;
}

/// Calls `f` with the value of every sample that counts for a quantity.
template <class F>
void for_each(const JointMotion& motion, const MatrixXd& gear_load, Ranged what, Index joint, F f) {
  for (Index i = 0; i < motion.size(); ++i) {
    if (of_all_joints(what) ? !motion.moving.col(i).any() : !motion.moving(joint, i)) continue;
    if (const double x = value_of(motion, gear_load, what, joint, i); std::isfinite(x)) f(x);
  }
}

/// The span in which a prediction is no extrapolation to speak of.
Span widened(const Span& trained, Ranged what) {
  constexpr double share = 0.1, kelvins = 2;
  const double margin = std::max(share * (trained.high - trained.low), what == Ranged::temperature ? kelvins : 0.0);
  return {what == Ranged::load ? 0 : trained.low - margin, trained.high + margin};  // less load is no strain
}

/// Whether `beyond` and `in_training` ask for it.
bool counts(const Span& trained, Ranged what, bool with_temperature) {
  return trained.known() && (what != Ranged::temperature || with_temperature);
}

Beyond beyond_of(const Span& trained, const JointMotion& motion, const MatrixXd& gear_load, Ranged what, Index joint) {
  Beyond out{.what = what, .trained = trained};
  const Span inside = widened(trained, what);
  double furthest = 0, outside = 0, all = 0;
  for_each(motion, gear_load, what, joint, [&](double x) {
    ++all;
    const double by = std::max(inside.low - x, x - inside.high);
    if (by <= 0) return;
    ++outside;
    if (by > furthest) furthest = by, out.furthest = x;
  });
  out.share = all > 0 ? outside / all : 0;
  return out;
}

}  // namespace

std::vector<JointRange> ranges_of(const JointMotion& motion, const MatrixXd& gear_load, bool with_temperature) {
  std::vector<JointRange> out(static_cast<std::size_t>(motion.q.rows()));
  for (std::size_t j = 0; j < out.size(); ++j)
    for (std::size_t k = 0; k < ranged_infos.size(); ++k) {
      if (static_cast<Ranged>(k) == Ranged::temperature && !with_temperature) continue;
      Span& span = out[j][k];
      for_each(motion, gear_load, static_cast<Ranged>(k), static_cast<Index>(j),
               [&](double x) { span.low = std::min(span.low, x), span.high = std::max(span.high, x); });
    }
  return out;
}

std::vector<std::vector<Beyond>> beyond(const std::vector<JointRange>& trained, const JointMotion& motion,
                                        const MatrixXd& gear_load, bool with_temperature) {
  std::vector<std::vector<Beyond>> out(trained.size());
  for (std::size_t j = 0; j < trained.size(); ++j)
    for (std::size_t k = 0; k < ranged_infos.size(); ++k) {
      const auto what = static_cast<Ranged>(k);
      if (!counts(trained[j][k], what, with_temperature)) continue;
      out[j].push_back(beyond_of(trained[j][k], motion, gear_load, what, static_cast<Index>(j)));
    }
  return out;
}

Eigen::Matrix<bool, Eigen::Dynamic, Eigen::Dynamic> in_training(const std::vector<JointRange>& trained,
                                                                const JointMotion& motion, const MatrixXd& gear_load,
                                                                bool with_temperature) {
  auto in = motion.moving;
  if (trained.empty()) in.setConstant(false);
  for (std::size_t j = 0; j < trained.size(); ++j)
    for (std::size_t k = 0; k < ranged_infos.size(); ++k) {
      const auto what = static_cast<Ranged>(k);
      const auto joint = static_cast<Index>(j);
      if (!counts(trained[j][k], what, with_temperature)) continue;
      const Span inside = widened(trained[j][k], what);
      for (Index i = 0; i < motion.size(); ++i) {
        const double x = value_of(motion, gear_load, what, joint, i);
        if (!(x < inside.low || x > inside.high)) continue;
        if (of_all_joints(what))
          in.col(i).setConstant(false);
        else
          in(joint, i) = false;
      }
    }
  return in;
}

Eigen::Matrix<bool, Eigen::Dynamic, Eigen::Dynamic> motion_in_span(const std::vector<JointRange>& trained,
                                                                   const JointMotion& motion) {
  constexpr double rounding = 1e-6;  // of the span: of the same sample in another unit
  Eigen::Matrix<bool, Eigen::Dynamic, Eigen::Dynamic> in;
  in.setConstant(motion.q.rows(), motion.size(), !trained.empty());
  for (std::size_t j = 0; j < trained.size(); ++j)
    for (const Ranged what : {Ranged::position, Ranged::speed, Ranged::acceleration}) {
      Span span = trained[j][static_cast<std::size_t>(what)];
      if (!span.known()) continue;
      if (what == Ranged::speed) span = {std::min(span.low, 0.0), std::max(span.high, 0.0)};
      const auto joint = static_cast<Index>(j);
      const double margin = rounding * (span.high - span.low);
      for (Index i = 0; i < motion.size(); ++i)
        if (const double x = value_of(motion, {}, what, joint, i); x < span.low - margin || x > span.high + margin)
          in(joint, i) = false;
    }
  return in;
}

bool loads(const Regressor& regressor, Index other, Index joint) {
  if (other == joint) return true;
  for (std::size_t c = 0; c < regressor.columns().size(); ++c)
    if (regressor.acts(c, other) && regressor.acts(c, joint)) return true;
  return false;
}

std::string beyond_training(const std::string& joint, bool slide, const std::vector<Beyond>& all) {
  std::vector<std::string> parts;
  for (const Beyond& b : all)
    if (b.share > 0)
      parts.push_back(fmt::format("{} reaches {:.3g} {} ({:.3g} .. {:.3g} in training; {:.2g} % of samples outside)",
                                  b.info().name, b.furthest, unit_of(b.info().unit, slide), b.trained.low,
                                  b.trained.high, 100 * b.share));
  return parts.empty() ? "" : fmt::format("joint {} leaves the training: {}", joint, joined(parts));
}

}  // namespace tribotwin::twin::identification
