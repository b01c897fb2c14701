#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <tribotwin/twin/diagnosis/observation.hpp>
#include <tribotwin/twin/io/text.hpp>

/// One friction curve of one joint of one robot on one date, as measured.
namespace tribotwin::twin::diagnosis::fleet {

/// What an observation is found by.
struct Key {
  std::string type, robot, joint;  ///< type of robot: may be empty
  std::int64_t time_s = 0;         ///< since 1970-01-01, of the date
  std::uint32_t curve = 1;         ///< of several on one date
  bool operator==(const Key&) const = default;
};
/// "robot R7, joint joint3, 2026-11-23, curve 1"
std::string name_of(const Key& key);
/// "joint joint3 of type irb6620"; the type of robot may be empty.
std::string name_of(const std::string& type, const std::string& joint);

/// Columns of equal length, speeds and friction >= 0.
struct LevelCurve {
  Key key;
  std::string file;
  std::size_t line = 0;  ///< of its first row, from 1
  std::vector<double> speed_rad_s, friction_nm;
  std::vector<double> load_norm, temperature_degC, stderr_nm, ripple_nm, lost_motion_rad;  ///< each may be empty

  std::string where() const;  ///< "FILE:LINE"
  /// Of all numbers, whatever the format of the file.
  std::uint32_t checksum() const;
};

/// The features of the curve, as observe() finds them with its loads at their mean; `weak` where it cannot.
/// The minimum is found from a grid by Levenberg and Marquardt; where that is in doubt (a bound, a number that exceeds
/// half of its value in sigma), observe() decides.
Observation observe_levels(const LevelCurve& curve, double load_sensitivity);

}  // namespace tribotwin::twin::diagnosis::fleet
