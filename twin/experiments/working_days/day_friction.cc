#include <algorithm>
#include <cmath>

#include <tribotwin/twin/experiments/working_days/day_friction.hpp>
#include <tribotwin/twin/numerics/correlation.hpp>

namespace tribotwin::twin::repeatability {
namespace {

constexpr double window_s = 3;  ///< of one value of friction over the day
constexpr double fewest_s = 1;  ///< of motion in such a window

}  // namespace

using namespace identification;
using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

DayFriction::DayFriction(const Regressor& regressor, const BaseParameters& base, const RobotFriction& law,
                         RobotParameters reference, const VectorXd& level_speed)
    : regressor_(regressor),
      base_(base),
      law_(law),
      reference_(std::move(reference)),
      rigid_(reference_),
      points_(static_cast<std::size_t>(regressor.joints())) {
  for (auto& joint : rigid_.friction) std::ranges::fill(joint, 0.0);
  for (Index j = 0; j < regressor.joints(); ++j) level_nm_.push_back(curve(j, level_speed(j), 1));
}

std::vector<Measured> DayFriction::add(const JointMotion& motion, double from_s) {
  const MatrixXd rest = motion.torque - predicted_torque(regressor_, base_, law_, rigid_, motion, 1);
  std::vector<Measured> out;
  for (Index j = 0; j < rest.rows(); ++j) {
    for (const auto& [first, past] : motion.segments) add_windows(motion, rest, j, first, past);
    std::vector<double> shape, torque;
    for (Index i = 0; i < motion.size(); ++i)
      if (motion.moving(j, i) && motion.time_s[static_cast<std::size_t>(i)] >= from_s)
        shape.push_back(curve(j, motion.qd(j, i), motion.direction(j, i))), torque.push_back(rest(j, i));
    const Eigen::Map<const VectorXd> f(shape.data(), static_cast<Index>(shape.size())), u(torque.data(), f.size());
    const double scale = f.dot(u) / f.squaredNorm(), level = level_nm_[static_cast<std::size_t>(j)];
    const VectorXd residual = u - scale * f;
    const double variance = residual.squaredNorm() / static_cast<double>(residual.size()) *
                            samples_per_independent({residual.data(), static_cast<std::size_t>(residual.size())});
    out.push_back({scale * level, std::sqrt(variance / f.squaredNorm()) * level});
  }
  return out;
}

std::vector<Warming> DayFriction::warming() const {
  std::vector<Warming> out(points_.size());
  for (std::size_t j = 0; j < points_.size(); ++j) {
    double work = 0;
    for (const auto& p : points_[j].kept) {
      out[j].power_w.push_back((p.work_J - work) / (p.time_s - (out[j].time_s.empty() ? 0 : out[j].time_s.back())));
      out[j].time_s.push_back(p.time_s);
      out[j].friction_nm.push_back(p.friction_nm);
      work = p.work_J;
    }
  }
  return out;
}

double DayFriction::curve(Index j, double speed, double direction) const {
  const auto at = static_cast<std::size_t>(j);
  return speed == 0 ? 0 : law_[at].filtered_torque(reference_.friction[at], speed, direction, 0, reference_degC);
}

/// Per window of window_s: friction at the mean time of its motion, and the work done until then.
void DayFriction::add_windows(const JointMotion& motion, const MatrixXd& rest, Index j, Index first, Index past) {
  Points& points = points_[static_cast<std::size_t>(j)];
  const auto time = [&](Index i) { return motion.time_s[static_cast<std::size_t>(i)]; };
  for (Index begin = first; begin < past;) {
    double cross = 0, own = 0, count = 0, moved_at = 0, work_at = 0;
    Index i = begin;
    for (; i < past && time(i) < time(begin) + window_s; ++i) {
      if (i > first) points.work_J += rest(j, i) * motion.qd(j, i) * (time(i) - time(i - 1));
      if (!motion.moving(j, i)) continue;
      const double f = curve(j, motion.qd(j, i), motion.direction(j, i));
      cross += f * rest(j, i), own += f * f, ++count, moved_at += time(i), work_at += points.work_J;
    }
    if (count * motion.period_s >= fewest_s)
      points.kept.push_back({moved_at / count, work_at / count, cross / own * level_nm_[static_cast<std::size_t>(j)]});
    begin = i;
  }
}

}  // namespace tribotwin::twin::repeatability
