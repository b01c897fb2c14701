#pragma once

#include <functional>
#include <utility>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/rigid_body/robot_torque.hpp>

/// Internal to this folder, not installed: the least-squares problem of a robot's dynamics. Unknowns: the base
/// parameters, then the friction parameters rotor by rotor (of the joints, then of coupled motors), then, where asked
/// for, a lag of every joint's torque.
namespace tribotwin::twin::identification {

class DynamicsProblem {
 public:
  /// The arguments must outlive it.
  DynamicsProblem(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                  const JointMotion& motion, unsigned threads);

  Eigen::Index joints() const { return regressor_.joints(); }
  Eigen::Index unknowns() const { return unknowns_; }
  Eigen::Index base_size() const { return base_.size(); }
  /// The unknown of a friction parameter, and the rotor and parameter of an unknown >= base_size().
  Eigen::Index friction_at(Eigen::Index rotor, Eigen::Index parameter) const {
    return base_.size() + first_friction_[static_cast<std::size_t>(rotor)] + parameter;
  }
  std::pair<std::size_t, std::size_t> place_of(Eigen::Index unknown) const;

  /// Makes the lag of every joint's torque [s] an unknown. `slope`: of the predicted torques by time [Nm/s; N/s],
  /// joints x samples. Lags are 0 in all predictions.
  void add_lags(Eigen::MatrixXd slope);
  Eigen::Index lag_at(Eigen::Index joint) const { return unknowns_ - joints() + joint; }

  /// Unknowns are free until they are fixed.
  void fix(Eigen::Index u) { free_[static_cast<std::size_t>(u)] = false; }
  void release(Eigen::Index u) { free_[static_cast<std::size_t>(u)] = true; }
  bool is_free(Eigen::Index u) const { return free_[static_cast<std::size_t>(u)]; }

  /// Samples [first, second) without a gap, long against the correlation of noise: the unit in which errors count as
  /// independent, and in which samples are held out. In order of time.
  using Block = std::pair<Eigen::Index, Eigen::Index>;
  const std::vector<Block>& blocks() const { return blocks_; }
  /// The index of each block's recording.
  std::vector<std::size_t> files() const;

  struct Pass {
    std::vector<Eigen::MatrixXd> R;  ///< per joint, of [columns, residual]; empty where not requested
    std::vector<std::vector<Eigen::MatrixXd>> of_block;  ///< the same of each block alone: [block][joint]
    Eigen::MatrixXd residual;                            ///< joints x samples; NaN at rest
  };
  /// Multiplies the row of a joint with this residual.
  using Weight = std::function<double(Eigen::Index joint, double residual)>;
  /// Residuals at `parameters` and the triangular factor of each joint's weighted rows.
  Pass pass(const RobotParameters& parameters, const Weight& weight) const { return pass(parameters, &weight); }
  /// Residuals alone.
  Pass residuals(const RobotParameters& parameters) const { return pass(parameters, nullptr); }

  /// Torques, joints x samples, at `parameters` and, to first order, changes of all unknowns: column `set[b]` of
  /// `changes` for the samples of block b. NaN where nothing moves.
  Eigen::MatrixXd predicted(const RobotParameters& parameters, const Eigen::MatrixXd& changes,
                            const std::vector<std::size_t>& set) const;

  /// The rows of every joint [columns(joint), residual] at `parameters`, and the block of each: to be weighted in more
  /// than one way. Linear in the samples in memory.
  struct Rows {
    Eigen::MatrixXd values;
    std::vector<std::size_t> block;
  };
  std::vector<Rows> rows(const RobotParameters& parameters) const;
  /// The unknowns that act on a joint, in the order of the columns of its rows.
  const std::vector<Eigen::Index>& columns(Eigen::Index joint) const {
    return columns_[static_cast<std::size_t>(joint)];
  }

  /// R of [all free unknowns, residual], each joint with its weight; `order` receives the unknown of each column.
  Eigen::MatrixXd combined(const Pass& pass, const Eigen::VectorXd& joint_weight,
                           std::vector<Eigen::Index>& order) const;
  /// [columns, residual]^T [columns, residual] of one block, columns as in `order`.
  Eigen::MatrixXd normal_matrix(const Pass& pass, std::size_t block, const Eigen::VectorXd& joint_weight,
                                const std::vector<Eigen::Index>& order) const;

  /// [Z, 0]^T W [Y, residual] of each group of samples, columns as in `order`: Z are the columns of `instruments`, a
  /// problem of the same unknowns. `group`: of each sample, 0 .. groups - 1.
  std::vector<Eigen::MatrixXd> moments(const DynamicsProblem& instruments, const RobotParameters& parameters,
                                       const Eigen::VectorXd& joint_weight, const std::vector<Eigen::Index>& order,
                                       const std::vector<Eigen::Index>& group, Eigen::Index groups) const;

 private:
  class Accumulator;
  Pass pass(const RobotParameters& parameters, const Weight* weight) const;

  const Regressor& regressor_;
  const BaseParameters& base_;
  const RobotFriction& friction_;
  const JointMotion& motion_;
  unsigned threads_;
  std::vector<Block> blocks_;
  std::vector<std::vector<Eigen::Index>> columns_;  ///< per joint, unknowns that act on it: base first
  std::vector<std::vector<Eigen::Index>> acting_;   ///< per joint, rotors whose friction acts on it: its own first
  std::vector<Eigen::Index> base_columns_, first_friction_;  ///< per joint; per rotor
  Eigen::MatrixXd slope_;                                    ///< of predicted torques; empty: lags are not unknown
  Eigen::Index unknowns_ = 0;
  std::vector<bool> free_;
  /// The regressor of the base parameters, a column per sample, once it was computed; empty where that is too much. A
  /// block is one thread's.
  mutable Eigen::MatrixXd kept_;
  mutable std::vector<char> is_kept_;
};

/// Unknowns of R's columns (`order`) that depend linearly on those before them, friction first: not identifiable.
std::vector<Eigen::Index> dependent(const Eigen::MatrixXd& R, const std::vector<Eigen::Index>& order,
                                    Eigen::Index base_size);
/// The least-squares solution of R = [columns, right-hand side], and its covariance for unit noise.
Eigen::VectorXd solved(const Eigen::MatrixXd& R);
Eigen::MatrixXd unit_covariance(const Eigen::MatrixXd& R);

}  // namespace tribotwin::twin::identification
