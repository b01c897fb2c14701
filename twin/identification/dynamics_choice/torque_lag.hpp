#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>

/// Torques that were recorded later, or earlier, than the positions of the same row: filters of the drive, a bus. A lag
/// is of the recordings, not of the robot.
namespace tribotwin::twin::identification {

/// A fit of prepared recordings with DynamicsOptions::lag.
using LagFit = std::function<Result<DynamicsFit>(JointMotion& motion)>;

struct TorqueLag {
  /// Per joint [s], > 0: the torque is late; `held` at 0 where it is not identifiable. One for all joints: each has it
  /// with the sigma of their mean, also where it does not show.
  std::vector<Estimate> lag;
  /// Mean of the joints' own by their sigmas, where they differ by chance only (chi-squared, 95 %) and any is
  /// estimated; of a robot with more than one joint.
  std::optional<Estimate> alike;
  JointMotion motion;  ///< without the lags
  DynamicsFit fit;     ///< of it; its sigmas count those of the lags
  std::vector<std::string> notes;

  /// For Preparation::lag_s.
  std::vector<double> lag_s() const;
};

enum class LagOf { joint, robot };

/// The lag of every joint's torque: each round fits the dynamics with the lag as one more unknown, whose column is the
/// slope of the predicted torque by time, and shifts the torques by what it finds, divided by the part of a lag that
/// this fit finds at all: noise of the slopes makes it less than 1, for the sigma as well. Held at 0 and named: a lag
/// whose sigma is more than a quarter of a period of the cut-off, one that does not come to rest, and one that half the
/// cut-off puts more than three sigmas elsewhere (elasticity, or friction that the law does not know). Rows near
/// reversals say nothing of the lag, even where they count: friction follows a reversal late by itself. Where files
/// differ by more than their sigmas, the lag's own counts that.
/// `of` the robot: what all torques have in common, as those of one bus, `alike`, becomes the lag of every joint; where
/// there is none, as of joints.
/// `preparation`'s own lags are where it starts. Errors as of prepare() and `fit`.
Result<TorqueLag> torque_lag(std::span<const RobotRecording> recordings, const Regressor& regressor,
                             Preparation preparation, const LagFit& fit, LagOf of = LagOf::joint);

}  // namespace tribotwin::twin::identification
