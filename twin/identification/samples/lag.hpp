#pragma once

#include <optional>

#include <tribotwin/twin/identification/samples/recording.hpp>

namespace tribotwin::twin {

struct Lag {
  double lag_s, stderr_s;
};

/// How late the torque column of a recording is behind its position column, from where the joint speeds up and slows
/// down: the shift at which torque is best explained by acceleration, gravity (harmonics of the position) and friction
/// (odd in speed, growing with |load|). Both columns pass the same symmetric filter before, which moves nothing. The
/// standard error is from the scatter between parts of the recording. Nothing where it is not identifiable: no ramps,
/// or less than a second of motion. `position_error_rad`: standard deviation of the position's noise or quantisation.
std::optional<Lag> lag_of_torque(const JointRecording& recording, double position_error_rad);

}  // namespace tribotwin::twin
