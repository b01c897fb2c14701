#include <algorithm>
#include <cmath>

#include <tribotwin/twin/identification/drive_gains/gain_equations.hpp>
#include <tribotwin/twin/numerics/filter.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/numerics/parallel.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

/// What turns with the speed, after the low-pass that torques passed: else friction per load would take what the filter
/// leaves of the turns, and of the load's changes of sign.
MatrixXd filtered(const JointMotion& motion, MatrixXd out) {
  for (const auto& [first, last] : motion.segments) {
    const auto end = static_cast<std::size_t>(last) - 1;
    const double steps = static_cast<double>(last - first - 1),
                 rate_hz = steps / (motion.time_s[end] - motion.time_s[static_cast<std::size_t>(first)]);
    if (steps < 20 || !(motion.cutoff_hz < 0.45 * rate_hz)) continue;
    for (Index j = 0; j < out.rows(); ++j) {
      auto own = out.row(j).segment(first, last - first);
      const std::vector<double> smooth =
          low_passed(std::vector<double>(own.begin(), own.end()), rate_hz, motion.cutoff_hz);
      std::ranges::copy(smooth, own.begin());
    }
  }
  return out;
}

/// Joints x samples: sgn(speed) and |load| sgn(speed), filtered.
struct FrictionColumns {
  MatrixXd direction, load;
};

GainBlock block_of(const GainStretch& stretch, Regressor& regressor, const BaseParameters& base,
                   const JointMotion& motion, const PlacedPayload* payload, const FrictionColumns& friction) {
  const GainColumns at{.base = base.size()};
  const Index joints = regressor.joints(), carried = payload ? first_column(regressor, payload->body.body) : -1;
  GainBlock out{.normal = {}, .samples = VectorXd::Zero(joints)};
  std::vector<MatrixXd> rows(static_cast<std::size_t>(joints), MatrixXd(at.size(), stretch.last - stretch.first));
  for (Index i = stretch.first; i < stretch.last; ++i) {
    if (!motion.moving.col(i).any()) continue;
    const MatrixXd& Y = regressor.at(motion.q.col(i), motion.qd.col(i), motion.qdd.col(i));
    for (Index j = 0; j < joints; ++j) {
      if (!motion.moving(j, i)) continue;
      auto row = rows[static_cast<std::size_t>(j)].col(static_cast<Index>(out.samples(j)++));
      for (Index k = 0; k < at.base; ++k) row(k) = Y(j, base.independent[static_cast<std::size_t>(k)]);
      row.segment<GainColumns::friction>(at.base) << friction.direction(j, i), motion.qd(j, i), friction.load(j, i), 1;
      row(at.torque()) = motion.torque(j, i);
      if (payload)
        row.tail(GainColumns::carried) = Y.row(j).segment(carried, GainColumns::carried).transpose();
      else
        row.tail(GainColumns::carried).setZero();
    }
  }
  for (Index j = 0; j < joints; ++j) {
    const auto own = rows[static_cast<std::size_t>(j)].leftCols(static_cast<Index>(out.samples(j)));
    out.normal.push_back(own * own.transpose());
  }
  return out;
}

VectorXd unit_scale(const MatrixXd& N) { return N.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse(); }

}  // namespace

std::vector<GainStretch> gain_stretches(const JointMotion& motion) {
  constexpr Index wanted = 48, shortest = 20;
  constexpr double periods = 12, shortest_period_s = 20;
  const Index length = std::max(shortest, (motion.size() + wanted - 1) / wanted);
  std::vector<GainStretch> out;
  std::size_t period = 0;
  for (std::size_t s = 0; s < motion.segments.size(); ++s) {
    const auto& [first, last] = motion.segments[s];
    const Index count = std::max<Index>(1, (last - first + length / 2) / length);
    const double samples = static_cast<double>(last - first),
                 most = std::ceil(periods * samples / static_cast<double>(motion.size())),
                 own = std::clamp(std::floor(samples * motion.period_s / shortest_period_s), 1.0, most);
    if (s > 0 && motion.file[s] != motion.file[s - 1]) ++period;
    for (Index k = 0; k < count; ++k) {
      const auto in_segment = static_cast<std::size_t>(own * static_cast<double>(k) / static_cast<double>(count));
      out.push_back({first + (last - first) * k / count, first + (last - first) * (k + 1) / count, motion.file[s],
                     period + in_segment});
    }
    period = out.back().period;
  }
  return out;
}

std::vector<GainBlock> gain_blocks(const Regressor& regressor, const BaseParameters& base, const JointMotion& motion,
                                   std::span<const GainStretch> stretches, std::span<const PlacedPayload> payloads,
                                   std::span<const int> payload_of_file, const MatrixXd& load, unsigned threads) {
  const MatrixXd sign = motion.qd.cwiseSign();
  const FrictionColumns friction{.direction = filtered(motion, sign),
                                 .load = filtered(motion, load.cwiseAbs().cwiseProduct(sign))};
  std::vector<GainBlock> out(stretches.size());
  in_parallel(stretches.size(), threads, [&](std::size_t b) {
    Regressor own = regressor;
    const int payload = payload_of_file[stretches[b].file];
    out[b] = block_of(stretches[b], own, base, motion,
                      payload < 0 ? nullptr : &payloads[static_cast<std::size_t>(payload)], friction);
    out[b].payload = payload, out[b].period = stretches[b].period;
  });
  return out;
}

VectorXd GainSystem::step() const {
  const VectorXd s = unit_scale(N);
  return s.cwiseProduct(symmetric_solution(s.asDiagonal() * N * s.asDiagonal(), s.cwiseProduct(g)));
}

MatrixXd GainSystem::inverse() const {
  const VectorXd s = unit_scale(N);
  return s.asDiagonal() * symmetric_inverse(s.asDiagonal() * N * s.asDiagonal()) * s.asDiagonal();
}

GroupCovariance group_covariance(const GainSystem& all, const VectorXd& precision, std::span<const GainSystem> groups) {
  const MatrixXd inverse = all.inverse();
  GroupCovariance out{.covariance = inverse * precision.asDiagonal() * inverse,
                      .freedom = VectorXd::Zero(precision.size())};
  VectorXd squares = VectorXd::Zero(precision.size()), fourths = squares;
  const auto count = static_cast<double>(groups.size());
  for (const GainSystem& one : groups) {
    GainSystem rest = all;
    rest.N -= one.N;
    rest.g = one.g;
    const VectorXd change = rest.step();
    out.covariance += (count - 1) / count * change * change.transpose();
    squares += change.cwiseAbs2(), fourths += change.cwiseAbs2().cwiseAbs2();
  }
  // Of normal errors the sum of fourth powers is three times what equal ones have.
  out.freedom = (3 * squares.array().square() / fourths.array().max(1e-300) - 1).max(1).min(count - 1);
  return out;
}

}  // namespace tribotwin::twin::identification
