#pragma once

#include <filesystem>
#include <memory>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/diagnosis/fleet/level_curve.hpp>

/// The friction curves of a fleet, one after the other: memory does not grow with their number.
namespace tribotwin::twin::diagnosis::fleet {

struct ReaderOptions {
  double torque_max_nm = 0;       ///< turns friction_norm into Nm where there is no friction_nm; 0: not known
  std::filesystem::path columns;  ///< YAML that maps foreign names; empty: none
};

class CurveReader {
 public:
  virtual ~CurveReader() = default;
  /// The next curve; false at the end. Fails with file, line and what would be right.
  virtual Result<bool> next(LevelCurve& curve) = 0;
};

/// A CSV file, or an HDF5 file with the same columns as data sets, with columns robot, joint, date and those of a
/// friction curve (one row per level, rows of one curve together; optionally type, of the robot, and curve, its number
/// on that date), or a folder ROBOT/JOINT/DATE.csv of friction curves in any format of tables that diagnose reads.
Result<std::unique_ptr<CurveReader>> open_curves(const std::filesystem::path& data, const ReaderOptions& options);

}  // namespace tribotwin::twin::diagnosis::fleet
