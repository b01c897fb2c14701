#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/curves/fit.hpp>
#include <tribotwin/twin/identification/resampling/folds.hpp>
#include <tribotwin/twin/identification/rigid_body/robot_torque.hpp>

/// A robot's whole dynamics from its motion (Hao 2021 and Pagani): base inertial parameters and the friction of every
/// joint together,
///
///   tau_j = Y_j(q, qd, qdd) beta + f_j(qd_j, load_j, T_j).
///
/// The sum of squares, weighted by each joint's noise, is minimised by Gauss-Newton: the equations are linear in beta
/// and in most friction parameters, so that a linear law needs one step. Rows where the joint rests are left out: there
/// friction is indeterminate. The regressor is never stored (TriangularFactor). Sigmas: information of the weighted
/// rows, enlarged or reduced to what estimates vary by when a block of time is left out (resampling/jackknife.hpp):
/// that holds for errors that are correlated and for a model that does not fit. Where files disagree by more, by that.
namespace tribotwin::twin::identification {

enum class Robust {
  none,
  huber,  ///< linear beyond 1.345 sigma
  tukey   ///< no weight beyond 4.685 sigma
};

/// As in options and output: "none", "huber", "tukey".
std::string_view name_of(Robust robust);

/// Instrumental variables (Janot 2014) against errors in the regressor, which pull least squares towards 0: a second
/// motion that follows the first but not its errors.
struct Instruments {
  JointMotion motion;               ///< q, qd, qdd and direction for each sample of the motion
  std::vector<Eigen::Index> group;  ///< per sample: errors are independent between groups, those of the instruments and
                                    ///< of their samples alike
  Eigen::Index groups = 0;
  std::vector<std::string> notes;
};
/// Whether instrumental variables estimate this law: it is linear in its parameters and knows no load, which would take
/// the errors of the torque into the instruments.
bool knows_instruments(const friction::LawInfo& law);

struct DynamicsOptions {
  Robust robust = Robust::none;
  bool weigh = true;          ///< joints by their noise
  bool rotor_inertia = true;  ///< false: base parameters that are a rotor inertia alone are 0, as of torques that were
                              ///< measured behind the gear
  double prior = 0;  ///< standard deviation of the bodies' inertial parameters about the model's, as a share of their
                     ///< size (inertial_scale of robot/inertial_prior.hpp); 0: none
  bool essential_only = false;  ///< base parameters that do not improve the fit are 0: backward elimination while F < 4
  bool evidence = false;        ///< find the prior that is the most probable (DynamicsFit::prior_by_evidence)
  bool lag = false;             ///< what the torques are late is unknown and counts in the sigmas: DynamicsFit::lag
  unsigned folds = 0;           ///< parts of the samples to leave out one at a time (resampling/folds.hpp); 0: none
  bool trial = false;  ///< a candidate among others: it ends early if it does not converge, and with `robust` each fold
                       ///< has weights by the other folds alone (which stores all rows), not by all samples
  const std::vector<Fold>* known_folds = nullptr;  ///< DynamicsFit::folds of a motion of the same times, to be the same
  const struct DynamicsFit* start = nullptr;  ///< of the same base parameters: begin there instead of at the model;
                                              ///< friction by its parameters' names
  /// Null: least squares. Else beta = (Z^T W Y)^-1 Z^T W tau with the instruments' regressor Z; of laws that are linear
  /// and know no load, without robust, prior, essential_only, evidence, lag and folds (ErrorKind::input).
  const Instruments* instruments = nullptr;
  unsigned threads = 2;
  std::function<void(double share)> progress;
};

struct JointResult {
  std::string name;
  double noise = 0;           ///< standard deviation of the residual [Nm; N]; NaN where the joint is left out
  double correlation = 1;     ///< number of correlated samples per independent one
  double relative_error = 0;  ///< rms of the residual / rms of the torque, while the joint moves; NaN as `noise`
  Eigen::Index samples = 0;   ///< in motion; 0: the joint is left out (JointMotion::left_out), its friction is not
                              ///< known
};

struct DynamicsFit {
  std::vector<Estimate> base;  ///< names as in BaseParameters; `held` at the model's value where not identifiable, at 0
                               ///< where not essential
  std::vector<std::vector<Estimate>> friction;       ///< per rotor
  std::vector<Eigen::MatrixXd> friction_covariance;  ///< per joint, of these; NaN rows where not estimated
  RobotParameters parameters;                        ///< the values of both
  /// Where asked for, per joint: how late its torque is behind its position [s], JointMotion::lag_s and what is left of
  /// it, which `parameters` do not count: torque_lag.hpp removes it. `held` where the torque does not tell.
  std::vector<Estimate> lag;
  std::vector<FileLag> lag_of_files;  ///< beside it, where it was asked for
  Eigen::MatrixXd information;        ///< of beta with free friction: inverse of its covariance; rows of 0 where held
  /// R, upper triangular: changes x of these unknowns (base parameters, then friction rotor by rotor) enlarge the
  /// weighted sum of squares, prior included, by |R x|^2. Base parameters that are not identifiable are among them,
  /// those that an option excludes are not.
  Eigen::MatrixXd objective;
  std::vector<Eigen::Index> unknowns;
  std::vector<JointResult> joints;
  double relative_error = 0;    ///< |residual| / |torque| over all joints and samples in motion
  double condition_number = 0;  ///< of the weighted regressor with unit columns
  double between_files = 1;     ///< variation of estimates between files / that between blocks of time, >= 1; sigmas
                                ///< contain it. 1 with fewer than three files
  /// Where folds were asked for: the torque [Nm; N] that the samples of the other folds foretell for each sample,
  /// joints x samples. Linearised about the parameters of all, which is exact for friction linear in its parameters;
  /// what the other folds do not tell is as in the model.
  Eigen::MatrixXd held_out;
  std::vector<Fold> folds;
  /// What the samples outside of each fold say: a fit of its own with `objective` of the unknowns `in_folds`.
  struct Partial {
    RobotParameters parameters;
    Eigen::MatrixXd objective;
  };
  std::vector<Partial> partial;
  std::vector<Eigen::Index> in_folds;
  double prior_by_evidence =
      0;                      ///< where asked for: the `prior` under which the data are the most probable
                              ///< (robot/inertial_prior.hpp); 0: none that is narrower than ten times the bodies' sizes
  bool instrumental = false;  ///< by instrumental variables: `joints` and errors are those of their residuals,
                              ///< `objective` is still that of least squares
  std::vector<std::string> notes;
};

/// "least_squares" or "instrumental_variables".
std::string_view estimator_of(const DynamicsFit& fit);

/// ErrorKind::input with what is missing from the data or wrong in them.
Result<DynamicsFit> fit_dynamics(const Regressor& regressor, const BaseParameters& base, const RobotFriction& friction,
                                 const JointMotion& motion, const DynamicsOptions& options = {});

}  // namespace tribotwin::twin::identification
