#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include <tribotwin/twin/identification/samples/recording.hpp>

/// Private to levels.cc: the stretches of constant speed in a recording, and which two of them make a level.
namespace tribotwin::twin::curves {

/// Minimum number of samples of a pass, and of one direction of a level.
inline constexpr std::size_t min_samples = 12;

/// A stretch of constant speed. q = at + speed (t - time of begin).
struct Pass {
  std::size_t begin, end;
  double speed, at;  ///< [rad/s], signed; [rad]
  double low, high;  ///< positions [rad]
  double magnitude() const { return std::abs(speed); }
};

/// The passes, in order of time. `left_out` gets a sentence for each stretch that was meant to be one and is not
/// steady.
std::vector<Pass> passes_of(const JointRecording& recording, std::vector<std::string>& left_out);

/// Standard deviation of the position's error [rad]: quantisation or noise, whichever shows.
double position_error_rad(const std::vector<double>& position_rad);

/// Two passes of one speed in opposite directions.
struct Pair {
  Pass forward, reverse;
  double low, high;  ///< common positions
  double speed() const { return 0.5 * (forward.speed - reverse.speed); }
  std::size_t begin() const { return std::min(forward.begin, reverse.begin); }
};

/// Whether two speeds > 0 are those of one level.
inline bool alike(double a, double b) {
  constexpr double same_speed = 0.03;  // relative
  return std::abs(a - b) <= same_speed * std::max(a, b);
}

/// The pairs, in order of time: neighbours in time belong together, those that cover the same positions first, for a
/// recording may repeat a level hundreds of times while it warms up. `left_out` gets a sentence for each single pass.
std::vector<Pair> paired(const JointRecording& recording, const std::vector<Pass>& passes,
                         std::vector<std::string>& left_out);

}  // namespace tribotwin::twin::curves
