#pragma once

#include <optional>
#include <string>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/plugins/friction/error.hpp>

/// Friction in the model m4 of BAM (Duclusaud 2024): with s = exp(-|v / dtheta_stribeck|^alpha)
/// at joint speed v and gear torque l [Nm], base + load_base |l| + s (stribeck + load_stribeck |l|) + viscous |v| [Nm].
namespace tribotwin::twin {

struct BamFriction {
  double base_nm = 0, stribeck_nm = 0, load_base = 0, load_stribeck = 0;
  double stribeck_rad_s = 1, alpha = 1, viscous_nm_s_rad = 0;
  double operator()(double speed_rad_s, double load_nm) const;

  double temperature_degC = 0, speed_max_rad_s = 0, load_max_nm = 0;  ///< where it was compared with the drive
  bool exact = false;                         ///< the law is m4's; else the numbers are a fit by least squares
  double rms_error_nm = 0, max_error_nm = 0;  ///< over both directions, from 3e-4 of the fastest speed
  double friction_min_nm = 0, friction_max_nm = 0;
  std::string lost;  ///< what of the drive is not in it, in words
};

/// At the temperature [degC], or at what comes nearest to T_amb within the range of the law. Speeds go to the end of
/// the law's range or to `speed_max_rad_s`. Fails where the law has no end of speed and none is given, or the
/// temperature lies outside its range.
Result<BamFriction> bam_friction(const drive::Drive& drive, std::optional<double> temperature_degC,
                                 std::optional<double> speed_max_rad_s);

/// The file that BAM's load_model reads; `actuator` is one of the names that BAM knows.
std::string bam_json(const BamFriction& friction, const std::string& actuator);

}  // namespace tribotwin::twin
