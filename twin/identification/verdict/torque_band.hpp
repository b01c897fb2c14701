#pragma once

#include <span>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/rigid_body/joint_motion.hpp>

/// The 95 % band of recorded torques about predicted ones: predicted +- half_width, one width per joint. It is
/// measured, not derived: that many samples of the training lie within it of what the fit of the other samples
/// predicts. So it has the scatter of recorded torques (filtered as for the fit), what the model does not explain and
/// the uncertainty of its parameters, and holds for motions within the training's ranges (in_training) and for torques
/// that are filtered alike.
namespace tribotwin::twin::identification {

/// Parts of the training that are left out, one at a time (DynamicsOptions::folds).
inline constexpr unsigned band_folds = 12;

/// Half the width [Nm; N] per joint: the 95 % quantile of |recorded - held_out| over the samples in which it moves; NaN
/// where it never does. `held_out`: DynamicsFit::held_out of this motion, joints x samples.
Eigen::VectorXd band_of(const JointMotion& motion, const Eigen::MatrixXd& held_out);

/// How many independent samples the errors of one joint count as, in order of time [Nm; N]: by their autocorrelation,
/// and no more than one per period of the cut-off of `motion`. 0 without errors.
double independent_errors(std::span<const double> errors, const JointMotion& motion);

/// Per joint, how many independent samples band_of has its quantile from; 0 where it never moves.
Eigen::VectorXd independent_of_band(const JointMotion& motion, const Eigen::MatrixXd& held_out);

/// The largest of as many independent errors is beyond 90 % of all (InBand::too_few) with a chance of 95 %: 1 - 0.9^29
/// (Wilks 1941, Determination of sample sizes for setting tolerance limits). Of fewer a band is not proven.
inline constexpr double least_of_band = 29;

/// Of one joint's samples for which the band is made.
struct InBand {
  static constexpr double too_few = 0.9;  ///< inside: twice as many are outside as the band allows
  static constexpr double enough = 20;    ///< independent samples
  Eigen::Index samples = 0, inside = 0;
  double independent = 0;  ///< how many independent samples they count as

  /// NaN without samples.
  double share() const { return static_cast<double>(inside) / static_cast<double>(samples); }
  /// Seen to be too narrow here, for whatever reason.
  bool fails() const { return samples >= 20 && share() < too_few; }
  /// In enough independent samples.
  bool is_refuted() const { return fails() && independent >= enough; }
};

}  // namespace tribotwin::twin::identification
