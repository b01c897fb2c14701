#include <algorithm>
#include <cmath>

#include <tribotwin/hil/motion/motion_profile.hpp>

namespace tribotwin::hil {
namespace {

MotionState after(const MotionState& s, double jerk, double t) {
  return {s.position_rad + t * (s.speed_rad_s + t * (s.acceleration_rad_s2 / 2 + t * jerk / 6)),
          s.speed_rad_s + t * (s.acceleration_rad_s2 + t * jerk / 2), s.acceleration_rad_s2 + t * jerk};
}

MotionState mirrored(const MotionState& s, double sign) {
  return {sign * s.position_rad, sign * s.speed_rad_s, sign * s.acceleration_rad_s2};
}

}  // namespace

/// Adds segments to a profile.
class MotionBuilder {
 public:
  MotionBuilder(const MotionLimits& limits, const MotionState& start) : limits_(limits), p_(start) {
    if (linear()) p_.end_.acceleration_rad_s2 = 0;
  }

  /// Speed once the acceleration is back at 0 without a further change.
  double coasting_rad_s() const {
    const auto& [position, speed, acceleration] = p_.end_;
    return linear() ? speed : speed + acceleration * std::abs(acceleration) / (2 * limits_.jerk_rad_s3);
  }

  /// To a speed with acceleration 0.
  void change_to(double speed) {
    const double coasting = coasting_rad_s(), now = p_.end_.speed_rad_s;
    const double up = limits_.acceleration_rad_s2, down = limits_.deceleration_rad_s2;
    if (coasting * speed < 0) {
      pulse(0, down);
      pulse(speed, up);
    } else if (std::abs(speed) <= std::abs(coasting)) {
      pulse(speed, down);
    } else {
      pulse(speed, now * coasting < 0 ? std::min(up, down) : up);  // it slows down first, then speeds up
    }
  }

  void cruise(double duration) { add(0, duration); }
  MotionProfile profile() const { return p_; }
  double position_rad() const { return p_.end_.position_rad; }

  /// Removes the last rounding.
  void arrive(const MotionState& end) { p_.end_ = end; }
  void mirror() {
    for (std::size_t i = 0; i < p_.count_; ++i) {
      auto& segment = p_.segments_[i];
      segment.begin = mirrored(segment.begin, -1);
      segment.jerk_rad_s3 *= -1;
    }
    p_.end_ = mirrored(p_.end_, -1);
  }

 private:
  bool linear() const { return std::isinf(limits_.jerk_rad_s3); }

  void add(double jerk, double duration) {
    if (!(duration > 0)) return;
    p_.segments_[p_.count_++] = {p_.end_, jerk, duration};
    p_.duration_s_ += duration;
    p_.end_ = after(p_.end_, jerk, duration);
  }

  /// One pulse of acceleration, of at most `limit` where the start is not beyond it, from the state to a speed.
  void pulse(double speed, double limit) {
    if (linear()) {
      const double change = speed - p_.end_.speed_rad_s;
      p_.end_.acceleration_rad_s2 = std::copysign(limit, change);
      add(0, std::abs(change) / limit);
    } else {
      const double jerk = limits_.jerk_rad_s3;
      const double sign = speed < coasting_rad_s() ? -1 : 1;
      const double begin = sign * p_.end_.acceleration_rad_s2, change = sign * (speed - p_.end_.speed_rad_s);
      const double square = std::max(0.0, jerk * change + begin * begin / 2);
      const double peak = std::min(std::sqrt(square), limit);
      // Speed gained on the way from `begin` to the peak and from the peak to 0.
      const double ramps = ((peak + begin) * std::abs(peak - begin) + peak * peak) / (2 * jerk);
      add(std::copysign(jerk, sign * (peak - begin)), std::abs(peak - begin) / jerk);
      p_.end_.acceleration_rad_s2 = sign * peak;
      if (peak == limit) add(0, (change - ramps) / limit);
      add(-sign * jerk, peak / jerk);
    }
    p_.end_.speed_rad_s = speed;
    p_.end_.acceleration_rad_s2 = 0;
  }

  const MotionLimits& limits_;
  MotionProfile p_;
};

namespace {

/// The greatest x found in [low, high] with f(x) <= value, where f is continuous and f(low) <= value.
template <class Function>
double bisect(Function f, double value, double low, double high) {
  for (int k = 0; k < 80 && low < high; ++k) {
    const double middle = low + (high - low) / 2;
    if (middle == low || middle == high) break;
    (f(middle) <= value ? low : high) = middle;
  }
  return low;
}

/// As `position_profile`, for a target that is ahead of where the start can stop.
MotionBuilder forward_profile(const MotionLimits& limits, const MotionState& start, double position, double end_speed) {
  const auto directly = [&](double speed) {
    MotionBuilder b(limits, start);
    b.change_to(speed);
    return b;
  };
  const auto stop_of = [&](double speed) { return directly(speed).position_rad(); };
  if (stop_of(end_speed) >= position) {  // no way to spare, or too short a one for this end speed
    end_speed = bisect(stop_of, position, 0, end_speed);
    MotionBuilder b = directly(end_speed);
    b.arrive({position, end_speed, 0});
    return b;
  }
  const auto by_way_of = [&](double speed) {
    MotionBuilder b = directly(speed);
    b.change_to(end_speed);
    return b.position_rad();
  };
  double cruise = limits.speed_rad_s;
  if (by_way_of(cruise) > position) {
    // From the speed at which the start coasts on, the distance grows with the cruising speed.
    const double from = std::clamp(MotionBuilder(limits, start).coasting_rad_s(), end_speed, cruise);
    cruise = by_way_of(from) <= position ? bisect(by_way_of, position, from, cruise)
                                         : bisect(by_way_of, position, end_speed, from);
  }
  MotionBuilder b = directly(cruise);
  const double rest = position - by_way_of(cruise);
  if (cruise > 0) b.cruise(rest / cruise);
  b.change_to(end_speed);
  b.arrive({position, end_speed, 0});
  return b;
}

}  // namespace

MotionState MotionProfile::at(double time_s) const {
  if (time_s >= duration_s_) {
    MotionState s = end_;
    s.position_rad += (time_s - duration_s_) * s.speed_rad_s;
    return s;
  }
  for (std::size_t i = 0; i < count_; ++i) {
    const Segment& segment = segments_[i];
    if (time_s <= segment.duration_s || i + 1 == count_) return after(segment.begin, segment.jerk_rad_s3, time_s);
    time_s -= segment.duration_s;
  }
  return end_;
}

MotionProfile speed_profile(const MotionLimits& limits, const MotionState& start, double speed_rad_s) {
  MotionBuilder b(limits, start);
  b.change_to(std::clamp(speed_rad_s, -limits.speed_rad_s, limits.speed_rad_s));
  return b.profile();
}

MotionProfile position_profile(const MotionLimits& limits, const MotionState& start, double position_rad,
                               double end_speed_rad_s) {
  const double end_speed = std::min(end_speed_rad_s, limits.speed_rad_s);
  if (position_rad >= speed_profile(limits, start, 0).end().position_rad)
    return forward_profile(limits, start, position_rad, end_speed).profile();
  MotionBuilder b = forward_profile(limits, mirrored(start, -1), -position_rad, end_speed);
  b.mirror();
  return b.profile();
}

double speed_to_stop_within(const MotionLimits& limits, double way_rad) {
  const auto way = [&](double speed) { return speed_profile(limits, {0, speed, 0}, 0).end().position_rad; };
  if (way(limits.speed_rad_s) <= way_rad) return limits.speed_rad_s;
  return bisect(way, way_rad, 0, limits.speed_rad_s);
}

MotionState within_speed(const MotionLimits& limits, MotionState state) {
  const double a = state.acceleration_rad_s2, left = limits.speed_rad_s - std::copysign(1, a) * state.speed_rad_s;
  const double most = left > 0 ? std::sqrt(2 * limits.jerk_rad_s3 * left) : 0;
  state.acceleration_rad_s2 = std::copysign(std::min(std::abs(a), most), a);
  return state;
}

}  // namespace tribotwin::hil
