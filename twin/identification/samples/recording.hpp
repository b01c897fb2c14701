#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

namespace tribotwin::twin {

/// What a controller records of one joint, arm side, one entry per sample: of the twin or of a real robot.
struct JointRecording {
  std::vector<double> time_s;  ///< strictly increasing; gaps are allowed
  std::vector<double> position_rad;
  std::vector<double> velocity_rad_s;  ///< may be empty
  std::vector<double> torque_nm;       ///< of the motor, positive drives forward
  std::vector<double> load_nm;         ///< what the gear transmits to the arm (gravity, external torque); may be empty
  std::vector<double> temperature_degC;  ///< of the lubricant; may be empty

  std::size_t size() const { return time_s.size(); }
};

/// Whether the columns are equally long, finite and in order of time. Fails with column and row (from 0).
Result<void> check(const JointRecording& recording);

/// How a controller measures a joint.
struct Sensors {
  double encoder_increments_per_turn = 0;  ///< per turn of the joint; 0: ideal, velocity included
  double torque_noise_nm = 0;              ///< standard deviation, white, arm side
  double sampling_hz = 250;
  double lag_s = 0;  ///< the torque column is late by this
};

/// The recording that a controller makes from signals at every step of a simulation: sampled, position quantised,
/// velocity differentiated from it, torque late and noisy. Load and temperature are taken as they are.
JointRecording sensed(const JointRecording& signals, const Sensors& sensors, std::uint64_t seed);

}  // namespace tribotwin::twin
