#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

/// A model without plugins, for engines that have none (MJX, Warp, WASM): every drive becomes MuJoCo's own frictionloss
/// and damping, fitted to its friction without load at one temperature.
namespace tribotwin::twin {

/// frictionloss + damping |qd| in place of a drive's friction, by least squares over joint speeds from 0 to speed_max.
struct NativeFriction {
  std::string joint;
  double temperature_degC = 0;
  double speed_max_rad_s = 0;                        ///< joint side; m/s for a slide
  double frictionloss_nm = 0, damping_nm_s_rad = 0;  ///< both >= 0
  double rms_error_nm = 0, max_error_nm = 0;         ///< of the fit, over its speeds
  double friction_min_nm = 0, friction_max_nm = 0;   ///< of the drive, over the same speeds
};

struct NativeModel {
  std::string xml;  ///< one file: includes are merged, folders of assets are absolute
  std::vector<NativeFriction> joints;
};

/// Fits at the temperature [degC], or at what comes nearest to each drive's T_amb within the range of its law. Speeds
/// go to the end of the law's range, or to `speed_max_rad_s` where given. A tribotwin.hysteresis becomes the stiffness
/// of its tendon; sensors of drives and activations in keyframes are removed. Fails where the model does not load, the
/// temperature is outside a law's range or a law has no end of speed and none is given.
Result<NativeModel> native_model(const std::filesystem::path& file, std::optional<double> temperature_degC,
                                 std::optional<double> speed_max_rad_s);

}  // namespace tribotwin::twin
