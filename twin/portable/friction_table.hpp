#pragma once

#include <optional>
#include <string>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/plugins/friction/error.hpp>

namespace tribotwin::twin {

/// The friction of a sliding joint over speed, load and temperature, for lookup tables of other simulators.
struct FrictionTable {
  std::string csv;  ///< speed_rad_s, load_nm, temperature_degC, friction_nm; a full grid, the first column slowest
  std::size_t rows = 0;
  double slowest_rad_s = 0;  ///< below it, and at rest, a table has nothing
  double error_nm = 0;       ///< largest error of linear interpolation in the centres of the grid's cells
  std::string lost;          ///< what of the drive is not in the table, in words
};

/// Speeds of both directions by the logarithm, to the end of the law's range or `speed_max_rad_s` of the joint; loads
/// of both signs and temperatures over the range of the law, where friction depends on them. Fails where the law has no
/// end of speed or temperature and none is given, or the temperature lies outside its range.
Result<FrictionTable> friction_table(const drive::Drive& drive, std::optional<double> temperature_degC,
                                     std::optional<double> speed_max_rad_s);

}  // namespace tribotwin::twin
