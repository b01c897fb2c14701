#pragma once

#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/thermal/thermal_recording.hpp>
#include <tribotwin/twin/numerics/correlated_noise.hpp>

/// Internal to this folder, not installed: the temperatures of sessions as a separable least-squares problem, nonlinear
/// in the time constants alone.
namespace tribotwin::twin::identification {

/// The least-squares solution of the linear unknowns at given time constants: gains c_i t_i (0 where they would be
/// negative), then A per file, then x_i0 of each session that does not begin at rest.
struct Projection {
  Eigen::MatrixXd columns;
  Eigen::VectorXd linear, residual;  ///< residual: model - measured
  double cost() const { return residual.squaredNorm(); }
};

/// Any number of nodes. `rested`: the first session of each file begins at ambient temperature.
class ThermalProblem {
 public:
  ThermalProblem(std::span<const HeatSession> sessions, Eigen::Index nodes, bool rested);

  Eigen::Index nodes() const { return nodes_; }
  Eigen::Index files() const { return files_; }
  Eigen::Index samples() const { return measured_.size(); }
  Eigen::Index unknowns() const { return unknowns_; }  ///< linear ones
  const Eigen::VectorXd& measured() const { return measured_; }
  SampleTimes times() const { return {time_s_, first_}; }
  double longest_s() const { return longest_s_; }  ///< session
  double step_s() const { return step_s_; }        ///< of the session with the shortest mean step
  /// Maximum - minimum of the temperatures of a file [K].
  double range_K(Eigen::Index file) const;

  Eigen::MatrixXd columns(const Eigen::VectorXd& log_t) const;
  Projection project(const Eigen::VectorXd& log_t) const;
  /// Derivatives of the temperatures with respect to the log time constants, the linear unknowns fixed.
  Eigen::MatrixXd slopes(const Eigen::VectorXd& log_t, const Eigen::VectorXd& linear) const;
  /// Derivatives by the log time constants, then by the linear unknowns. A gain that is 0 counts as free: it adds to
  /// the uncertainty of the time constants.
  Eigen::MatrixXd jacobian(const Eigen::VectorXd& log_t, const Projection& at) const;
  /// Range of log time constants: from two samples to ten times the longest session.
  std::pair<double, double> range() const;

 private:
  std::span<const HeatSession> sessions_;
  Eigen::Index nodes_, files_ = 0, unknowns_ = 0;
  std::vector<Eigen::Index> file_, first_;          ///< per session: its file, from 0; its first row
  std::vector<std::optional<Eigen::Index>> start_;  ///< per session: column of its x_i0
  std::vector<double> time_s_;
  double longest_s_ = 0, step_s_ = 0;
  Eigen::VectorXd measured_;
};

/// The best log time constants of a grid, one or two nodes; empty where none has a finite error.
Eigen::VectorXd global_search(const ThermalProblem& problem);

/// Ceres from there; only the first `free` of log_t move.
void descend(const ThermalProblem& problem, Eigen::VectorXd& log_t, Eigen::Index free);

}  // namespace tribotwin::twin::identification
