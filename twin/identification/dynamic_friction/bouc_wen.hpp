#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/transmission/hysteresis.hpp>
#include <tribotwin/twin/identification/estimates.hpp>
#include <tribotwin/twin/io/tables/table_options.hpp>

/// Bouc-Wen springs (plugins/transmission/hysteresis.hpp) from recordings of torsion and torque (RH380-N study,
/// section 4.1). The stiffness polynomials are linear given x. Shape and share are searched as ln |x|max, gamma / beta,
/// n and w, whose effects are much less correlated than those of beta and n. x at the start of each recording is
/// searched, too.
namespace tribotwin::twin::identification {

inline constexpr std::string_view bouc_wen_equation =
    "tau_g = w k phi + (1 - w) k x [Nm], x' = phi' - beta |phi'| |x|^(n-1) x - gamma phi' |x|^n, k = k0(T) + k1(T) "
    "|phi| + k2(T) |phi|^3, ki(T) = ki0 + ki1 T + ki2 T^2; RH380-N study (2), (3)";

/// One recording. Loops are independent of time.
struct LoopRecording {
  std::vector<double> torsion_rad;       ///< motor angle / gear ratio - arm angle
  std::vector<double> torque_nm;         ///< transmitted by the gear, arm side, of the sign of the torsion
  std::vector<double> temperature_degC;  ///< empty: not recorded
};

struct LoopRecordings {
  std::vector<LoopRecording> recordings;
  std::vector<std::string> notes;
};
/// Reads CSV `time_s, torsion_rad, torque_nm[, temperature_degC]`, a recording per file. ErrorKind::input with file and
/// what would be right, also where values do not fit their header (degrees, motor angles, opposite sign).
Result<LoopRecordings> read_loops(std::span<const std::filesystem::path> files, const TableOptions& options = {});

struct HysteresisFit : Estimates {      ///< parameters: k00 .. k22, w, beta, gamma, n
  transmission::Hysteresis hysteresis;  ///< its ranges are those of the data
  double normalised_mse = 0;            ///< mean squared error / variance of the torque
};

/// ErrorKind::work with what the data lack: motion, reversals, samples, hysteresis.
Result<HysteresisFit> fit_hysteresis(std::span<const LoopRecording> recordings, unsigned threads = 2);

/// The torsion without noise: x depends on the sign of phi', so that noise would count as motion back and forth.
/// Smoothed until the removed part exceeds the noise (estimated from third differences), then replaced between
/// significant reversals by the nearest monotone course. Appends the indices of the reversals to `reversals`.
std::vector<double> monotone_course(std::span<const double> torsion, std::vector<std::size_t>& reversals);

}  // namespace tribotwin::twin::identification
