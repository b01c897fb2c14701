#pragma once

#include <span>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>

/// Instruments from a motion that is repeated: what other repetitions say of a sample follows its motion, but has
/// other errors of the encoder. Nothing is assumed of the controller or the robot. A simulation that is tied to the
/// recorded positions would have their errors below the bandwidth of the tie, and one that the recorded torque drives
/// would have those of the torque, which are the errors of the equations.
namespace tribotwin::twin::identification {

/// Looks for the period of every stretch of `motion`, which `prepare` made of `recordings`. Samples without another
/// repetition no longer count as `moving`. ErrorKind::input where nothing repeats, where repetitions are too short for
/// sigmas, and where all repetitions are within .45 of the encoder's step of each other: then its errors repeat as
/// well. Those that are, as where the sampling meets a multiple of the period, are no instruments.
Result<Instruments> instruments_of_repetitions(std::span<const RobotRecording> recordings, const Regressor& regressor,
                                               JointMotion& motion);

}  // namespace tribotwin::twin::identification
