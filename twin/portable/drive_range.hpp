#pragma once

#include <optional>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/plugins/friction/error.hpp>

/// Internal to portable/: where the friction of a drive is taken for formats that know less. Messages name the options
/// of `tribotwin export`.
namespace tribotwin::twin {

/// The end of the law's range, or `given` [rad/s, joint side]. Fails where the law has no end and none is given.
Result<double> fastest_rad_s(const drive::Drive& drive, std::optional<double> given);

/// Fails where the law depends on temperature and was not identified at this one.
Result<void> require_identified_at(const drive::Drive& drive, double temperature_degC);

/// Of the law, at most torque_max, and of the load table; 0 where neither knows a load [Nm].
double largest_load_nm(const drive::Drive& drive);

}  // namespace tribotwin::twin
