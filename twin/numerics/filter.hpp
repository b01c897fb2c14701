#pragma once

#include <span>
#include <vector>

namespace tribotwin::twin::identification {

/// Butterworth low-pass of fourth order (bilinear transform, prewarped) run forwards and backwards: no phase, half the
/// amplitude at the cut-off, eighth order in all. The signal is continued at both ends by its point reflection, over
/// three periods of the cut-off or as far as it reaches. cutoff_hz in (0, sampling_hz / 2).
std::vector<double> low_passed(std::span<const double> signal, double sampling_hz, double cutoff_hz);

}  // namespace tribotwin::twin::identification
