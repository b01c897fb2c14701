#include <algorithm>
#include <array>
#include <cmath>

#include <tribotwin/twin/identification/drive_gains/gain_equations.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>
#include <tribotwin/twin/numerics/parallel.hpp>

namespace tribotwin::twin::identification {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

/// A stretch of a recording, by its samples [first, last).
struct Stretch {
  Index first, last;
  std::size_t file;
};

std::vector<Stretch> stretches_of(const JointMotion& motion) {
  constexpr Index wanted = 48, shortest = 20;
  const Index length = std::max(shortest, (motion.size() + wanted - 1) / wanted);
  std::vector<Stretch> out;
  for (std::size_t s = 0; s < motion.segments.size(); ++s) {
    const auto& [first, last] = motion.segments[s];
    const Index count = std::max<Index>(1, (last - first + length / 2) / length);
    for (Index k = 0; k < count; ++k)
      out.push_back({first + (last - first) * k / count, first + (last - first) * (k + 1) / count, motion.file[s]});
  }
  return out;
}

/// Columns of friction: it may grow with the load, else that would count as a gain.
std::array<double, GainColumns::friction> friction_columns(const JointFriction& friction, const JointMotion& motion,
                                                           Index joint, Index sample, double load) {
  static constexpr std::array<double, GainColumns::friction> any{};
  std::array<double, GainColumns::friction> by;
  friction.filtered_torque(any, motion.qd(joint, sample), motion.direction(joint, sample), load, 20, by.data());
  return by;
}

GainBlock block_of(const Stretch& stretch, Regressor& regressor, const BaseParameters& base, const JointMotion& motion,
                   const PlacedPayload* payload, const MatrixXd& load) {
  const JointFriction friction(coulomb_viscous_load(), {}, {.offset = true});
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
      const auto by = friction_columns(friction, motion, j, i, load(j, i));
      std::ranges::copy(by, row.data() + at.base);
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

std::vector<GainBlock> gain_blocks(const Regressor& regressor, const BaseParameters& base, const JointMotion& motion,
                                   std::span<const PlacedPayload> payloads, std::span<const int> payload_of_file,
                                   const MatrixXd& load, unsigned threads) {
  const auto stretches = stretches_of(motion);
  std::vector<GainBlock> out(stretches.size());
  in_parallel(stretches.size(), threads, [&](std::size_t b) {
    Regressor own = regressor;
    const int payload = payload_of_file[stretches[b].file];
    out[b] = block_of(stretches[b], own, base, motion,
                      payload < 0 ? nullptr : &payloads[static_cast<std::size_t>(payload)], load);
    out[b].payload = payload;
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
