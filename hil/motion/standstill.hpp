#pragma once

#include <cmath>

namespace tribotwin::hil {

/// Slower than this, a motor counts as standing: 5 rpm, far below the speeds at which friction is identified.
inline constexpr double standing_motor_rad_s = 0.5;

/// `speed_rad_s` of the joint; `gear_ratio`: motor turns per joint turn.
inline bool stands(double speed_rad_s, double gear_ratio) {
  return std::abs(speed_rad_s) * gear_ratio < standing_motor_rad_s;
}

}  // namespace tribotwin::hil
