#pragma once

#include <span>
#include <vector>

namespace tribotwin::twin::identification {

/// Butterworth low-pass of fourth order (bilinear transform, prewarped) run forwards and backwards: no phase, half the
/// amplitude at the cut-off, eighth order in all. The signal is continued at both ends by its point reflection, over
/// three periods of the cut-off or as far as it reaches. cutoff_hz in (0, sampling_hz / 2).
std::vector<double> low_passed(std::span<const double> signal, double sampling_hz, double cutoff_hz);

/// Derivatives of equidistant samples by maximally flat central differences (Fornberg 1988) over eight samples on
/// either side; beside the ends over as many as there are, at the ends that beside them. Of a sine of a fifth of the
/// sampling rate right to 1e-4, of three tenths to 1.4 %. At least three samples.
std::vector<double> first_derivative(std::span<const double> signal, double sampling_hz);
std::vector<double> second_derivative(std::span<const double> signal, double sampling_hz);

}  // namespace tribotwin::twin::identification
