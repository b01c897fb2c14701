#pragma once

#include <span>
#include <string>
#include <vector>

#include <tribotwin/render/figure/figures.hpp>

/// Long columns of samples as curves of few points.
namespace tribotwin::render {

/// About 600 of many samples: minimum and maximum of each of 300 stretches, in their order, and the last. No peak is
/// lost. Few samples stay as they are.
Trace envelope(std::string label, std::span<const double> time_s, std::span<const double> values);

/// Root mean square in windows of equal time, without the NaN.
Trace rms_trace(std::string label, std::span<const double> time_s, std::span<const double> values, double window_s);

bool any_finite(const Trace& trace);

}  // namespace tribotwin::render
