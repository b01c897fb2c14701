#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/twin/io/tables/table_options.hpp>

/// Measured friction of any origin: the input of a fit.
namespace tribotwin::twin::identification {

/// Columns of equal length. Speed on the law's side [rad/s], friction in the law's unit; both >= 0 after folding
/// (friction opposes motion, laws are odd). Load over torque_max, magnitude. `standard_error` is empty or
/// that of each level.
struct Samples {
  std::vector<double> speed, load, temperature_degC, friction, standard_error;
  /// 1 for positive motion, -1 for negative, 0 for a level of both. Empty where no sample is known to be of one.
  std::vector<double> direction;
  /// Of a level of both directions: half of forward - backward [unit of the law], each positive against its motion; NaN
  /// where it is not known. Empty without any.
  std::vector<double> difference;
  std::vector<std::uint32_t> curve;  ///< which curve a sample belongs to, from 0, ascending
  std::size_t left_out = 0;          ///< rows of the files that held no finite numbers
  std::vector<std::string> notes;    ///< what a reader of the result should know about the data

  std::size_t size() const { return speed.size(); }
  std::uint32_t curves() const { return curve.empty() ? 0 : curve.back() + 1; }
  Samples subset(std::span<const std::size_t> rows) const;
};

/// 1 / standard error^2 of each sample, over their mean; empty without standard errors.
std::vector<double> weights_of(const Samples& samples);

struct ReadOptions {
  double torque_max_nm = 0;  ///< to turn Nm into normalised torque and back; 0: not known
  double gear_ratio = 0;     ///< to turn joint into motor speeds; 0: not known
  TableOptions table;        ///< with the joint, which may be empty where a table has one joint only
};

/// Reads curve CSV (speed_rad_s, load_norm, temperature_degC, friction_norm or friction_nm, optionally stderr_norm or
/// stderr_nm, both directions by themselves, and curve), time-series CSV (time_s, position_rad, velocity_rad_s,
/// torque_nm, optionally temperature_degC and load_nm) or telemetry.h5, in the units of `law`. Rows with a cell that is
/// no finite number are left out and counted. Fails with file, line or column and what would be right: also where the
/// numbers cannot be what their header says (degrees for radians, swapped columns). Directions are known where speeds
/// have both signs, where a curve has friction_forward and friction_backward, and where a recording has load_nm.
Result<Samples> read_samples(std::span<const std::filesystem::path> files, const friction::LawInfo& law,
                             const ReadOptions& options);

/// Friction curves in memory, under the names of a curve file; of one length or empty. Without `curve`, curves are told
/// apart as in a file.
struct CurveColumns {
  std::vector<double> speed_rad_s, load_norm, temperature_degC, friction_norm, friction_nm, stderr_norm, stderr_nm,
      curve;
};
/// The same as read_samples of a curve file with these columns; messages call them `name`.
Result<Samples> samples_of(const CurveColumns& columns, const std::string& name, const friction::LawInfo& law,
                           const ReadOptions& options);

}  // namespace tribotwin::twin::identification
