#include <algorithm>
#include <limits>
#include <numeric>

#include <tribotwin/twin/identification/rigid_body/dynamics_problem.hpp>
#include <tribotwin/twin/numerics/parallel.hpp>
#include <tribotwin/twin/numerics/triangular_factor.hpp>

namespace tribotwin::twin::identification {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

namespace {

/// About `wanted` blocks of equal length over all segments.
std::vector<DynamicsProblem::Block> blocks_of(const JointMotion& motion) {
  constexpr Index wanted = 48, shortest = 20;
  const Index length = std::max(shortest, (motion.size() + wanted - 1) / wanted);
  std::vector<DynamicsProblem::Block> out;
  for (const auto& [first, last] : motion.segments) {
    const Index count = std::max<Index>(1, (last - first + length / 2) / length);
    for (Index k = 0; k < count; ++k)
      out.emplace_back(first + (last - first) * k / count, first + (last - first) * (k + 1) / count);
  }
  return out;
}

}  // namespace

DynamicsProblem::DynamicsProblem(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                                 const JointMotion& motion, unsigned threads)
    : regressor_(regressor),
      base_(base),
      friction_(friction),
      motion_(motion),
      threads_(threads),
      blocks_(blocks_of(motion)) {
  for (const JointFriction& f : friction) {
    first_friction_.push_back(unknowns_);
    unknowns_ += f.size();
  }
  for (Index j = 0; j < joints(); ++j) {
    auto& columns = columns_.emplace_back();
    for (Index k = 0; k < base.size(); ++k)
      for (Index c = 0; c < base.from_all.cols(); ++c)
        if (base.from_all(k, c) != 0 && regressor.acts(static_cast<std::size_t>(c), j)) {
          columns.push_back(k);
          break;
        }
    base_columns_.push_back(static_cast<Index>(columns.size()));
    auto& rotors = acting_.emplace_back();
    for (Index r = 0; r < regressor.rotors(); ++r) {
      if (regressor.turns(r, j) == 0) continue;
      rotors.push_back(r);
      for (Index p = 0; p < friction[static_cast<std::size_t>(r)].size(); ++p) columns.push_back(friction_at(r, p));
    }
  }
  unknowns_ += base.size();
  constexpr Index most_kept = 8'000'000;  // numbers: of short recordings, and of those that a choice is made by
  if (joints() * base.size() * motion.size() <= most_kept) {
    kept_.resize(joints() * base.size(), motion.size());
    is_kept_.assign(static_cast<std::size_t>(motion.size()), false);
  }
  free_.assign(static_cast<std::size_t>(unknowns_), true);
}

void DynamicsProblem::add_lags(MatrixXd slope) {
  slope_ = std::move(slope);
  for (auto& columns : columns_) columns.push_back(unknowns_++);
  free_.resize(static_cast<std::size_t>(unknowns_), true);
}

std::vector<std::size_t> DynamicsProblem::files() const {
  std::vector<std::size_t> out;
  std::size_t segment = 0;
  for (const auto& [first, last] : blocks_) {
    while (motion_.segments[segment].second < last) ++segment;
    out.push_back(motion_.file[segment]);
  }
  return out;
}

std::pair<std::size_t, std::size_t> DynamicsProblem::place_of(Index unknown) const {
  std::size_t r = friction_.size() - 1;
  while (unknown < friction_at(static_cast<Index>(r), 0)) --r;
  return {r, static_cast<std::size_t>(unknown - friction_at(static_cast<Index>(r), 0))};
}

/// One thread's part of a pass.
class DynamicsProblem::Accumulator {
 public:
  Accumulator(const DynamicsProblem& problem, const RobotParameters& parameters, const Weight* weight)
      : problem_(problem),
        parameters_(parameters),
        weight_(weight),
        regressor_(problem.regressor_),
        by_(static_cast<Index>(friction::max_parameters) + 4, problem.regressor_.rotors()),
        value_(VectorXd::Zero(problem.regressor_.rotors())),
        rigid_(problem.joints()),
        Yb_(problem.joints(), problem.base_size()) {
    if (weight)
      for (const auto& c : problem.columns_) R_.emplace_back(static_cast<Index>(c.size()) + 1);
  }

  /// Adds sample i of the motion; writes its column of residuals.
  void add(Index i, MatrixXd& residuals) {
    const JointMotion& motion = problem_.motion_;
    if (!motion.moving.col(i).any()) return;
    evaluate(i);
    for (Index j = 0; j < problem_.joints(); ++j) {
      if (!motion.moving(j, i)) continue;
      const double residual = residual_of(j, i);
      residuals(j, i) = residual;
      if (weight_) add_row(i, j, residual);
    }
  }
  /// Writes the torque of sample i at the parameters plus, to first order, `change`; NaN where none was recorded.
  void predict(Index i, const Eigen::Ref<const VectorXd>& change, MatrixXd& torque) {
    const JointMotion& motion = problem_.motion_;
    evaluate(i, true);
    for (Index j = 0; j < problem_.joints(); ++j) {
      torque(j, i) = motion.torque(j, i) - residual_of(j, i) + Yb_.row(j) * change.head(problem_.base_size());
      for (const Index r : problem_.acting_[static_cast<std::size_t>(j)]) {
        const Index count = problem_.friction_[static_cast<std::size_t>(r)].size();
        torque(j, i) +=
            regressor_.turns(r, j) * by_.col(r).head(count).dot(change.segment(problem_.friction_at(r, 0), count));
      }
    }
  }
  /// `resting`: also of rotors that do not count as moving.
  void evaluate(Index i, bool resting = false) {
    const JointMotion& motion = problem_.motion_;
    find_rigid(i);
    for (Index j = 0; j < problem_.joints(); ++j) rigid_(j) = Yb_.row(j) * parameters_.base;
    if (motion.carried_torque.size() > 0) rigid_ += motion.carried_torque.col(i);
    for (Index r = 0; r < regressor_.rotors(); ++r)
      if (resting || acts(r, i))
        value_(r) = friction_of(regressor_, problem_.friction_, parameters_, motion, r, i, rigid_, by_.col(r).data());
  }
  /// Row of a joint in the evaluated sample, [columns(j), residual].
  template <typename Row>
  void write_row_of(Index i, Index j, Row&& row) const {
    write_row(i, j, 1, residual_of(j, i), row);
  }
  /// Row of a joint in the evaluated sample, [columns, residual] with columns at their `place` (-1: none), else 0.
  void row_of(Index i, Index j, const std::vector<Index>& place, VectorXd& row) const {
    VectorXd own(static_cast<Index>(problem_.columns_[static_cast<std::size_t>(j)].size()) + 1);
    write_row(i, j, 1, residual_of(j, i), own);
    row.setZero();
    for (Index c = 0; c + 1 < own.size(); ++c)
      if (const Index at = place[static_cast<std::size_t>(
              problem_.columns_[static_cast<std::size_t>(j)][static_cast<std::size_t>(c)])];
          at >= 0)
        row(at) = own(c);
    row(row.size() - 1) = own(own.size() - 1);
  }
  /// Per joint, upper triangular.
  std::vector<MatrixXd> factors() const {
    std::vector<MatrixXd> out;
    for (const TriangularFactor& R : R_) out.push_back(R.R());
    return out;
  }

 private:
  /// Yb_ of sample i.
  void find_rigid(Index i) {
    const JointMotion& motion = problem_.motion_;
    const bool kept = problem_.kept_.size() > 0;
    if (kept && problem_.is_kept_[static_cast<std::size_t>(i)]) {
      Yb_.reshaped() = problem_.kept_.col(i);
      return;
    }
    const MatrixXd& Y = regressor_.at(motion.q.col(i), motion.qd.col(i), motion.qdd.col(i));
    for (Index k = 0; k < problem_.base_size(); ++k)
      Yb_.col(k) = Y.col(problem_.base_.independent[static_cast<std::size_t>(k)]);
    if (kept) problem_.kept_.col(i) = Yb_.reshaped(), problem_.is_kept_[static_cast<std::size_t>(i)] = true;
  }

  /// Whether a rotor's friction acts on a joint that moves.
  bool acts(Index rotor, Index i) const {
    for (Index j = 0; j < problem_.joints(); ++j)
      if (regressor_.turns(rotor, j) != 0 && problem_.motion_.moving(j, i)) return true;
    return false;
  }

  /// Of the evaluated sample.
  double residual_of(Index j, Index i) const {
    double residual = problem_.motion_.torque(j, i) - rigid_(j);
    for (const Index r : problem_.acting_[static_cast<std::size_t>(j)]) residual -= regressor_.turns(r, j) * value_(r);
    return residual;
  }

  void add_row(Index i, Index j, double residual) {
    write_row(i, j, (*weight_)(j, residual), residual, R_[static_cast<std::size_t>(j)].row());
  }

  template <typename Row>
  void write_row(Index i, Index j, double w, double residual, Row&& row) const {
    const auto at = static_cast<std::size_t>(j);
    const Index own_base = problem_.base_columns_[at];
    for (Index c = 0; c < own_base; ++c) row(c) = w * Yb_(j, problem_.columns_[at][static_cast<std::size_t>(c)]);
    Index column = own_base;
    for (const Index r : problem_.acting_[at])
      for (Index p = 0; p < problem_.friction_[static_cast<std::size_t>(r)].size(); ++p)
        row(column++) = w * regressor_.turns(r, j) * by_(p, r);
    if (problem_.slope_.size()) row(column) = -w * problem_.slope_(j, i);  // late torques are those of before
    row(row.size() - 1) = w * residual;
  }

  const DynamicsProblem& problem_;
  const RobotParameters& parameters_;
  const Weight* weight_;
  Regressor regressor_;
  MatrixXd by_;     ///< derivatives of the friction, a column per rotor
  VectorXd value_;  ///< friction per rotor
  VectorXd rigid_;  ///< torque per joint
  MatrixXd Yb_;
  std::vector<TriangularFactor> R_;
};

DynamicsProblem::Pass DynamicsProblem::pass(const RobotParameters& parameters, const Weight* weight) const {
  Pass out{.R = {},
           .of_block = std::vector<std::vector<MatrixXd>>(blocks_.size()),
           .residual = MatrixXd::Constant(joints(), motion_.size(), std::numeric_limits<double>::quiet_NaN())};
  in_parallel(blocks_.size(), threads_, [&](std::size_t b) {
    Accumulator own(*this, parameters, weight);
    for (Index i = blocks_[b].first; i < blocks_[b].second; ++i) own.add(i, out.residual);
    out.of_block[b] = own.factors();
  });
  if (!weight) return out;
  out.R.resize(columns_.size());
  in_parallel(columns_.size(), threads_, [&](std::size_t j) {
    TriangularFactor all(static_cast<Index>(columns_[j].size()) + 1);
    for (const auto& block : out.of_block) all.add(block[j]);
    out.R[j] = all.R();
  });
  return out;
}

std::vector<DynamicsProblem::Rows> DynamicsProblem::rows(const RobotParameters& parameters) const {
  std::vector<Rows> out(columns_.size());
  Eigen::Matrix<Index, Eigen::Dynamic, Eigen::Dynamic> first(joints(), std::ssize(blocks_));  // row of each block
  for (Index j = 0; j < joints(); ++j) {
    Rows& own = out[static_cast<std::size_t>(j)];
    for (std::size_t b = 0; b < blocks_.size(); ++b) {
      first(j, static_cast<Index>(b)) = std::ssize(own.block);
      const Index count = motion_.moving.row(j).segment(blocks_[b].first, blocks_[b].second - blocks_[b].first).count();
      own.block.insert(own.block.end(), static_cast<std::size_t>(count), b);
    }
    own.values.resize(std::ssize(own.block), std::ssize(columns(j)) + 1);
  }
  in_parallel(blocks_.size(), threads_, [&](std::size_t b) {
    Accumulator accumulator(*this, parameters, nullptr);
    auto at = first.col(static_cast<Index>(b));
    for (Index i = blocks_[b].first; i < blocks_[b].second; ++i) {
      if (!motion_.moving.col(i).any()) continue;
      accumulator.evaluate(i);
      for (Index j = 0; j < joints(); ++j)
        if (motion_.moving(j, i)) accumulator.write_row_of(i, j, out[static_cast<std::size_t>(j)].values.row(at(j)++));
    }
  });
  return out;
}

MatrixXd DynamicsProblem::predicted(const RobotParameters& parameters, const MatrixXd& changes,
                                    const std::vector<std::size_t>& set) const {
  MatrixXd torque = MatrixXd::Constant(joints(), motion_.size(), std::numeric_limits<double>::quiet_NaN());
  in_parallel(blocks_.size(), threads_, [&](std::size_t b) {
    Accumulator own(*this, parameters, nullptr);
    for (Index i = blocks_[b].first; i < blocks_[b].second; ++i)
      own.predict(i, changes.col(static_cast<Index>(set[b])), torque);
  });
  return torque;
}

MatrixXd DynamicsProblem::combined(const Pass& pass, const VectorXd& joint_weight, std::vector<Index>& order) const {
  order.clear();
  std::vector<Index> place(static_cast<std::size_t>(unknowns_), -1);
  for (Index u = 0; u < unknowns_; ++u)
    if (is_free(u)) place[static_cast<std::size_t>(u)] = static_cast<Index>(order.size()), order.push_back(u);
  const auto width = static_cast<Index>(order.size()) + 1;
  TriangularFactor all(width);
  for (std::size_t j = 0; j < columns_.size(); ++j) {
    const MatrixXd& R = pass.R[j];
    for (Index r = 0; r < R.rows(); ++r) {
      auto row = all.row();
      for (Index c = 0; c + 1 < R.cols(); ++c)
        if (const Index at = place[static_cast<std::size_t>(columns_[j][static_cast<std::size_t>(c)])]; at >= 0)
          row(at) = joint_weight(static_cast<Index>(j)) * R(r, c);
      row(width - 1) = joint_weight(static_cast<Index>(j)) * R(r, R.cols() - 1);
    }
  }
  return all.R();
}

MatrixXd DynamicsProblem::normal_matrix(const Pass& pass, std::size_t block, const VectorXd& joint_weight,
                                        const std::vector<Index>& order) const {
  std::vector<Index> place(static_cast<std::size_t>(unknowns_), -1);
  for (std::size_t c = 0; c < order.size(); ++c) place[static_cast<std::size_t>(order[c])] = static_cast<Index>(c);
  const auto width = static_cast<Index>(order.size()) + 1;
  MatrixXd out = MatrixXd::Zero(width, width);
  for (std::size_t j = 0; j < columns_.size(); ++j) {
    std::vector<Index> from, to;  // columns of the joint's R that are free, and where they are in `order`
    for (std::size_t c = 0; c < columns_[j].size(); ++c)
      if (const Index at = place[static_cast<std::size_t>(columns_[j][c])]; at >= 0)
        from.push_back(static_cast<Index>(c)), to.push_back(at);
    const MatrixXd& R = pass.of_block[block][j];
    from.push_back(R.cols() - 1), to.push_back(width - 1);
    const MatrixXd own = joint_weight(static_cast<Index>(j)) * R(Eigen::all, from);
    out(to, to) += own.transpose() * own;
  }
  return out;
}

std::vector<MatrixXd> DynamicsProblem::moments(const DynamicsProblem& instruments, const RobotParameters& parameters,
                                               const VectorXd& joint_weight, const std::vector<Index>& order,
                                               const std::vector<Index>& group, Index groups) const {
  std::vector<Index> place(static_cast<std::size_t>(unknowns_), -1);
  for (std::size_t c = 0; c < order.size(); ++c) place[static_cast<std::size_t>(order[c])] = static_cast<Index>(c);
  const auto width = static_cast<Index>(order.size()) + 1;
  std::vector<std::vector<Index>> samples(static_cast<std::size_t>(groups));
  for (Index i = 0; i < motion_.size(); ++i)
    if (motion_.moving.col(i).any()) samples[static_cast<std::size_t>(group[static_cast<std::size_t>(i)])].push_back(i);
  std::vector<MatrixXd> out(samples.size(), MatrixXd::Zero(width, width));
  in_parallel(samples.size(), threads_, [&](std::size_t g) {
    Accumulator own(*this, parameters, nullptr), other(instruments, parameters, nullptr);
    VectorXd Y(width), Z(width);
    for (const Index i : samples[g]) {
      own.evaluate(i), other.evaluate(i);
      for (Index j = 0; j < joints(); ++j) {
        if (!motion_.moving(j, i)) continue;
        own.row_of(i, j, place, Y), other.row_of(i, j, place, Z);
        Z(width - 1) = 0;
        out[g] += joint_weight(j) * joint_weight(j) * Z * Y.transpose();
      }
    }
  });
  return out;
}

std::vector<Index> dependent(const MatrixXd& R, const std::vector<Index>& order, Index base_size) {
  std::vector<Index> sequence(order.size());
  std::iota(sequence.begin(), sequence.end(), 0);
  std::stable_partition(sequence.begin(), sequence.end(),
                        [&](Index c) { return order[static_cast<std::size_t>(c)] >= base_size; });
  MatrixXd Q(R.rows(), R.cols());
  Index found = 0;
  std::vector<Index> out;
  for (const Index c : sequence) {
    const double length = R.col(c).norm();
    VectorXd rest = length > 0 ? VectorXd(R.col(c) / length) : VectorXd::Zero(R.rows());
    for (int pass = 0; pass < 2; ++pass) rest -= Q.leftCols(found) * (Q.leftCols(found).transpose() * rest);
    if (rest.norm() < 1e-6)
      out.push_back(order[static_cast<std::size_t>(c)]);
    else
      Q.col(found++) = rest.normalized();
  }
  return out;
}

VectorXd solved(const MatrixXd& R) {
  const Index n = R.cols() - 1;
  VectorXd x = R.col(n).head(n);
  R.topLeftCorner(n, n).triangularView<Eigen::Upper>().solveInPlace(x);
  return x;
}

MatrixXd unit_covariance(const MatrixXd& R) {
  const Index n = R.cols() - 1;
  MatrixXd inverse = MatrixXd::Identity(n, n);
  R.topLeftCorner(n, n).triangularView<Eigen::Upper>().solveInPlace(inverse);
  return inverse * inverse.transpose();
}

}  // namespace tribotwin::twin::identification
