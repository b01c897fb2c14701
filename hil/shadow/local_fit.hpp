#pragma once

#include <deque>
#include <optional>

/// Derivatives and means of measured signals whose samples are late, unevenly spaced or missing. Everything here is a
/// least-squares fit in a window of +-half_s around a time, at the samples' own times, so a lost sample leaves a gap in
/// the data and no step in the result.
///
/// A parabola's second derivative is the true one averaged with the weight (1 - s^2)^2, s = (t - t0) / half_s.
/// Averaging measured torques with that weight passes them through the same filter, and the filter's delay and damping
/// cancel in their difference.
namespace tribotwin::hil {

struct Sample {
  double time_s = 0, value = 0;
  double span_s = 0;  ///< > 0: the value is the mean over this time up to time_s; 0: that at time_s

  double middle_s() const { return time_s - span_s / 2; }
};
/// In order of time.
using Samples = std::deque<Sample>;

/// Position, speed and acceleration, in the unit of the samples and seconds.
struct Motion {
  double position = 0, speed = 0, acceleration = 0;
};

/// Whether the window is filled: at least five samples, and no gap, also at its ends, longer than `gap_s`.
bool covered(const Samples& samples, double time_s, double half_s, double gap_s);

/// The parabola through the samples of a covered window. Samples that lie off it by more than six times the median
/// (sampled long before or after their stamp) do not count; `resolution` is what no sample is expected to hold better.
Motion local_motion(const Samples& samples, double time_s, double half_s, double resolution);

/// The mean of a covered window with the weight (1 - s^2)^2, of the straight line through the samples. Samples that are
/// means count by their spans, all or none of them.
double local_mean(const Samples& samples, double time_s, double half_s);

/// Removes what lies before `time_s`.
void forget_before(Samples& samples, double time_s);

}  // namespace tribotwin::hil
