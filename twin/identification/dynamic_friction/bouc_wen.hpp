#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/transmission/hysteresis.hpp>
#include <tribotwin/twin/identification/estimates.hpp>

/// Bouc-Wen springs (plugins/transmission/hysteresis.hpp) from recordings of torsion and torque, paper 4 section 4.1.
/// The stiffness polynomials are linear given x; shape and share are searched as ln |x|max, gamma / beta, n and w,
/// where their effects are far less alike than those of beta and n. x at the start of a recording is found with them
/// and forgotten.
namespace tribotwin::twin::identification {

inline constexpr std::string_view bouc_wen_equation =
    "tau_g = w k phi + (1 - w) k x [Nm], x' = phi' - beta |phi'| |x|^(n-1) x - gamma phi' |x|^n, k = k0(T) + k1(T) "
    "|phi| + k2(T) |phi|^3, ki(T) = ki0 + ki1 T + ki2 T^2; P4 (2), (3)";

/// One recording. Loops do not depend on time, so that it has none.
struct LoopRecording {
  std::vector<double> torsion_rad;       ///< motor angle / gear ratio - arm angle
  std::vector<double> torque_nm;         ///< that the gear transmits, arm side, > 0 with torsion
  std::vector<double> temperature_degC;  ///< empty: not recorded
};

struct LoopRecordings {
  std::vector<LoopRecording> recordings;
  std::vector<std::string> notes;
};
/// Reads CSV `time_s, torsion_rad, torque_nm[, temperature_degC]`, a recording per file. Fails with file and what would
/// be right, also where the numbers cannot be what their header says.
Result<LoopRecordings> read_loops(std::span<const std::filesystem::path> files);

struct HysteresisFit : Estimates {      ///< parameters: k00 .. k22, w, beta, gamma, n
  transmission::Hysteresis hysteresis;  ///< its ranges are those of the data
  double normalised_mse = 0;            ///< mean squared error / variance of the torque
};

/// Fails with a sentence on what the data lack.
Result<HysteresisFit> fit_hysteresis(std::span<const LoopRecording> recordings, unsigned threads = 2);

/// The torsion without the noise that would count as motion to and fro, |phi'| being what turns x round: smoothed as
/// far as only noise is lost (its size follows from third differences), then between the reversals that stand out of it
/// the nearest monotone course. Indices of the reversals are added to `reversals`.
std::vector<double> monotone_course(std::span<const double> torsion, std::vector<std::size_t>& reversals);

}  // namespace tribotwin::twin::identification
