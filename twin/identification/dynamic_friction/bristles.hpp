#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/estimates.hpp>

/// Bristles (LuGre, plugins/drive/drive.hpp) over a static law that is known, from recordings of pre-sliding and
/// reversals: the drive's own step is simulated along the recorded speed, its error of torque is what is made small.
/// sigma1 is linear given the deflection; ln sigma0 and ln vd are searched, and the deflection at the start of each
/// recording with them.
namespace tribotwin::twin::identification {

inline constexpr std::string_view lugre_equation =
    "z' = w - sigma0 |w| z / g, friction = sigma0 z + sigma1 e^-(w/vd)^2 z' + h over the law g + h; P4 (5)";

/// One recording, arm side.
struct SlidingRecording {
  std::vector<double> time_s, velocity_rad_s;
  std::vector<double> torque_nm;         ///< friction, > 0 with motion
  std::vector<double> temperature_degC;  ///< empty: not recorded
  std::vector<double> load_nm;           ///< signed like tau_m; empty: no load
};

struct SlidingRecordings {
  std::vector<SlidingRecording> recordings;
  std::vector<std::string> notes;
};
/// Reads CSV `time_s, velocity_rad_s, torque_nm[, temperature_degC, load_nm]`, a recording per file, with what the law
/// of `drive` depends on. Fails with file and what would be right.
Result<SlidingRecordings> read_sliding(std::span<const std::filesystem::path> files, const drive::Drive& drive);

struct BristleFit : Estimates {  ///< parameters: sigma0, sigma1, vd
  drive::Bristles bristles;
  double normalised_mse = 0;  ///< mean squared error / variance of the torque
};

/// Bristles over the law, the load table and the gear of `drive`. Fails with a sentence on what the data lack.
Result<BristleFit> fit_bristles(const drive::Drive& drive, std::span<const SlidingRecording> recordings,
                                unsigned threads = 2);

}  // namespace tribotwin::twin::identification
