#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/estimates.hpp>
#include <tribotwin/twin/io/tables/table_options.hpp>

/// Bristles (LuGre, plugins/drive/drive.hpp) over a known static law, from recordings of pre-sliding and reversals. The
/// drive's own step is simulated along the recorded speed; the squared error of the torque is minimised. sigma1 is
/// linear given the deflection; ln sigma0, ln vd and the deflection at the start of each recording are searched.
namespace tribotwin::twin::identification {

inline constexpr std::string_view lugre_equation =
    "z' = w - sigma0 |w| z / g, friction = sigma0 z + sigma1 e^-(w/vd)^2 z' + h over the law g + h; RH380-N study (5)";

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
/// Reads CSV `time_s, velocity_rad_s, torque_nm[, temperature_degC, load_nm]`, a recording per file. The columns that
/// the law of `drive` depends on are required. ErrorKind::input with file and what would be right.
Result<SlidingRecordings> read_sliding(std::span<const std::filesystem::path> files, const drive::Drive& drive,
                                       const TableOptions& options = {});

struct BristleFit : Estimates {  ///< parameters: sigma0, sigma1, vd
  drive::Bristles bristles;
  double normalised_mse = 0;  ///< mean squared error / variance of the torque
};

/// Bristles over the law, the load table and the gear of `drive`. sigma0 [1/rad of a normalised law, Nm/rad], sigma1
/// [s/rad; Nm s/rad], vd [rad/s]. ErrorKind::work with what the data lack: motion, samples, pre-sliding.
Result<BristleFit> fit_bristles(const drive::Drive& drive, std::span<const SlidingRecording> recordings,
                                unsigned threads = 2);

}  // namespace tribotwin::twin::identification
