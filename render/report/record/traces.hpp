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

/// Root mean square of the values that are no NaN, in windows of equal length that together cover the samples: as many
/// as come nearest to `window_s` > 0 [s], at least one. A point in the middle of each window with samples; NaN where
/// all its values are. `time_s` ascends.
Trace rms_trace(std::string label, std::span<const double> time_s, std::span<const double> values, double window_s);

bool any_finite(const Trace& trace);

}  // namespace tribotwin::render
