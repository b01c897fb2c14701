#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/tables/table_options.hpp>
#include <tribotwin/twin/robot/motion.hpp>

namespace tribotwin::twin {

/// Recorded set points, with measurements where the file has them.
/// Any table: columns `time_s`, `position_JOINT_rad` (`_m` for a slide; one per driven joint, others are ignored) and,
/// for all of them or none, `velocity_JOINT_rad_s` (`_m_s`). Where it has `set_point_JOINT_rad` these are the set
/// points, and positions and temperatures are what was measured; so also with commanded speeds `set_point_JOINT_rad_s`
/// and torques `set_point_JOINT_nm` (`_m_s`, `_n`), in place of positions or beside them. JSON: {"entries":
/// [{"timestamp", "goal_position", "position", "temp", ...}], ...numbers}, one joint, as recorded by Rhoban's BAM test
/// bench; top-level numbers (kp, mass, vin, ...) are kept by name.
struct SetPoints {
  std::vector<std::string> joints;                    ///< empty for JSON: the model's only joint
  std::vector<double> time_s;                         ///< strictly increasing
  std::vector<std::vector<double>> position_rad;      ///< per joint; empty where only speeds or torques are commanded
  std::vector<std::vector<double>> velocity_rad_s;    ///< per joint; may be empty; of a smooth motion
  std::vector<std::vector<double>> command_rad_s;     ///< per joint; may be empty; held from row to row
  std::vector<std::vector<double>> command_nm;        ///< alike; of the motor, seen from the arm
  std::vector<std::vector<double>> measured_rad;      ///< per joint, NaN where nothing was measured; may be empty
  std::vector<std::vector<double>> temperature_degC;  ///< per joint, NaN where not measured; empty as measured_rad
  std::vector<bool> torque_on;                        ///< the servos were switched on; may be empty
  std::vector<std::pair<std::string, double>> numbers;
  std::vector<std::string> notes;  ///< how the file was understood, and what it lacks
};

/// Fails with a message that names file and line (CSV) or entry (JSON).
Result<SetPoints> read_set_points(const std::filesystem::path& file, const TableOptions& options = {});

/// The motion of these set points, from `start_rad` on (per drive), `delay_s` late. `drives`: of each recorded joint;
/// the others stay where they start.
Motion motion_of(const SetPoints& points, std::span<const std::size_t> drives, std::vector<double> start_rad,
                 double delay_s);

}  // namespace tribotwin::twin
