#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

namespace tribotwin::twin {

/// Recorded set points, with measurements where the file has them.
/// CSV: columns `time_s`, `position_JOINT_rad` (`_m` for a slide; one per driven joint, others are ignored) and, for
/// all of them or none, `velocity_JOINT_rad_s` (`_m_s`). JSON: {"entries": [{"timestamp", "goal_position", "position",
/// "temp", ...}], ...numbers}, one joint, as recorded by Rhoban's BAM test bench; top-level numbers (kp, mass, vin,
/// ...) are kept by name.
struct SetPoints {
  std::vector<std::string> joints;                  ///< empty for JSON: the model's only joint
  std::vector<double> time_s;                       ///< strictly increasing
  std::vector<std::vector<double>> position_rad;    ///< per joint
  std::vector<std::vector<double>> velocity_rad_s;  ///< per joint; may be empty
  std::vector<double> measured_rad;                 ///< JSON only
  std::vector<double> temperature_degC;             ///< JSON only
  std::vector<bool> torque_on;                      ///< JSON only: the servo was switched on
  std::vector<std::pair<std::string, double>> numbers;
};

/// Fails with a message that names file and line (CSV) or entry (JSON).
Result<SetPoints> read_set_points(const std::filesystem::path& file);

}  // namespace tribotwin::twin
