#pragma once

#include <array>
#include <cstddef>
#include <limits>

/// Ramps of the profile modes (CiA 402-2, 6086h), free of time and objects: limits and a state of motion give a
/// profile, and a profile gives the set point at each time.
///
/// A change of speed is one pulse of acceleration that ends at 0. A move to a position is a change to a cruising speed,
/// the cruise, and a change to the end speed; the cruising speed is found by bisection, since the distance of both
/// changes is continuous in it. Any state is a valid start. Units: joint side, SI.
namespace tribotwin::hil {

struct MotionLimits {
  double speed_rad_s = 1;          ///< > 0
  double acceleration_rad_s2 = 1;  ///< > 0, while the speed grows
  double deceleration_rad_s2 = 1;  ///< > 0, while it falls
  double jerk_rad_s3 = unlimited;  ///< > 0; unlimited: linear ramps
  static constexpr double unlimited = std::numeric_limits<double>::infinity();
};

struct MotionState {
  double position_rad = 0, speed_rad_s = 0, acceleration_rad_s2 = 0;
};

class MotionProfile {
 public:
  /// Stands at `state`, or goes on with its speed.
  explicit MotionProfile(const MotionState& state) : end_(state) {}
  MotionProfile() = default;

  double duration_s() const { return duration_s_; }
  /// The set point `time_s` >= 0 after the start; after the end the end speed stays.
  MotionState at(double time_s) const;
  const MotionState& end() const { return end_; }

 private:
  friend class MotionBuilder;
  struct Segment {
    MotionState begin;
    double jerk_rad_s3, duration_s;
  };
  static constexpr std::size_t longest = 13;  // two pulses through standstill, a cruise, two more
  std::array<Segment, longest> segments_{};
  std::size_t count_ = 0;
  MotionState end_;
  double duration_s_ = 0;
};

/// To a speed, and on with it. `speed_rad_s` beyond the limit is cut to it. An acceleration of the start that leads
/// beyond a limit is reduced by the jerk.
MotionProfile speed_profile(const MotionLimits& limits, const MotionState& start, double speed_rad_s);

/// To a position, where the speed is `end_speed_rad_s` >= 0 in the direction of arrival, or as much of it as the way
/// allows. It overshoots only where the start is too fast to stop in time, and then returns.
MotionProfile position_profile(const MotionLimits& limits, const MotionState& start, double position_rad,
                               double end_speed_rad_s = 0);

/// The greatest speed [rad/s], at most that of the limits, from which a stop needs no more than `way_rad`.
double speed_to_stop_within(const MotionLimits& limits, double way_rad);

/// The state without what of its acceleration would lead beyond the speed limit at this jerk: where limits fall on the
/// way, the speed limit counts more than the jerk.
MotionState within_speed(const MotionLimits& limits, MotionState state);

}  // namespace tribotwin::hil
