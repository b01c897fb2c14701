#pragma once

#include <string>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/experiments/friction/campaign.hpp>

/// The rows of curves.csv.
namespace tribotwin::twin {

/// Speed motor side [rad/s], torques over torque_max_nm or arm side [Nm].
inline constexpr char curve_columns[] =
    "series,curve,speed_rad_s,load_norm,temperature_degC,friction_norm,stderr_norm,friction_forward_norm,"
    "friction_backward_norm,friction_nm,stderr_nm,lag_s,ripple_nm,lost_motion_rad\n";

/// Measures one curve: one row per level, without the header. A function of campaign and curve alone, on any thread.
/// ErrorKind::work with the curve's number, series and conditions.
Result<std::string> measured_rows(const Campaign& campaign, const Curve& curve);

}  // namespace tribotwin::twin
