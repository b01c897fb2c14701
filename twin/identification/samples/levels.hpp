#pragma once

#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/samples/recording.hpp>

/// Friction levels from a recording of the twin or of a real robot: stretches of constant speed, each forward one
/// paired with the reverse one of the same speed over the same positions.
///
/// Motor torque at constant speed is u(q) = G(q) +- F (Bittencourt 2012 (3)). Both directions of a level are fitted
/// together, G as a polynomial in the position where they overlap and F as what changes sign with the direction:
/// Bittencourt 2012 (4), (u+ - u-)/2, at equal positions. A torque column that is late by a time L shows G shifted by
/// speed L forwards and backwards, so the two directions differ by 2 speed L in position (Zhou 2024 (13)). L is
/// identified from the ramps (lag.hpp) or, in a recording without any, by what all levels have in common, and removed.
namespace tribotwin::twin {

struct LevelOptions {
  std::vector<double> speeds_rad_s;  ///< required levels, > 0, arm side; others are left out. Empty: all levels found
  double centre_rad = 0,
         width_rad = std::numeric_limits<double>::infinity();  ///< measure where |q - centre| <= width / 2
  std::optional<double> lag_s;  ///< of the torque column where it is known; otherwise estimated
};

/// One direction, Bittencourt 2012 (3): motor torque minus load, positive.
struct OneWay {
  double friction_nm, stderr_nm;
};

/// Arm side. Standard errors are of the mean: standard deviation of what the trend with |load| leaves / sqrt(n / c)
/// with c = 1 + 2 sum of its autocorrelations up to 5 c (at least 1, for servo ripple is not white), and the error of
/// the lag where it matters.
struct Level {
  double speed_rad_s;                       ///< > 0, slope of the position
  double friction_nm, stderr_nm;            ///< direction-independent, Bittencourt 2012 (4)
  std::optional<OneWay> forward, backward;  ///< where the recording has load_nm
  /// Mean of |load|, with the sign of its mean. Without load_nm: of (u+ + u-)/2, which is the load if friction is the
  /// same both ways.
  double load_nm;
  double temperature_degC;  ///< mean; NaN where the recording has none
  std::size_t samples;      ///< of both directions
  /// Zhou 2024 (13): how far the constant stretches of both directions were apart before they were cut to their
  /// overlap, over speed.
  double offset_s;
  double begin_s, end_s;  ///< of the two passes
  /// Amplitude of what in the friction is periodic in the joint's angle, at the strongest harmonic of a turn that
  /// stands out of the noise (false alarm 1e-4) here and at another speed; 0 where none does or the travel is shorter
  /// than three periods. It is removed from the friction of slower levels that are too short to show it.
  double ripple_nm = 0;
  /// Travel after the reversal between the passes until the torque has changed by 3/2 of the friction: 0 in a stiff
  /// gear, the width of the gap in one with backlash. 0 as well where the joint turns too fast, its inertia
  /// hiding the change.
  double lost_motion_rad = 0;
};

struct Levels {
  std::vector<Level> levels;          ///< in the order of LevelOptions::speeds_rad_s, else of time
  double lag_s = 0;                   ///< of the torque column, as taken out
  double lag_stderr_s = 0;            ///< 0 where it was given, 0.02 where it is not identifiable
  std::vector<std::string> left_out;  ///< why other stretches of constant speed are no levels
};

/// Fails with what is missing: "no reverse pass at 0.42 rad/s ...".
Result<Levels> levels_of(const JointRecording& recording, const LevelOptions& options = {});

}  // namespace tribotwin::twin
