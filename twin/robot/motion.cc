#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include <tribotwin/twin/robot/motion.hpp>

namespace tribotwin::twin {

Motion& Motion::move_to(std::vector<double> target, std::span<const double> speed,
                        std::span<const double> acceleration) {
  // The trapezoid of the joint that needs longest, followed by all in proportion; ramps long enough for everyone.
  double duration = 0, ramp = 0;
  for (std::size_t j = 0; j < target.size(); ++j) {
    const double distance = std::abs(target[j] - last_[j]);
    if (distance == 0) continue;
    const double peak = std::min(speed[j], std::sqrt(distance * acceleration[j]));
    ramp = std::max(ramp, peak / acceleration[j]);
    duration = std::max(duration, distance / peak + peak / acceleration[j]);
  }
  duration = std::max(duration, 2 * ramp);
  if (duration == 0) return *this;
  segments_.push_back({end_s_, duration, ramp, last_, target, {}, {}});
  end_s_ += duration;
  last_ = std::move(target);
  return *this;
}

Motion& Motion::dwell(double duration_s) {
  if (duration_s > 0) {
    segments_.push_back({end_s_, duration_s, duration_s / 2, last_, last_, {}, {}});
    end_s_ += duration_s;
  }
  return *this;
}

Motion& Motion::hold_at(double time_s, std::vector<double> position, std::vector<double> velocity,
                        std::vector<double> torque) {
  if (!segments_.empty()) segments_.back().duration_s = time_s - segments_.back().start_s;
  segments_.push_back({time_s, 0, 0, position, position, {}, {}, std::move(velocity), std::move(torque)});
  end_s_ = time_s;
  last_ = std::move(position);
  return *this;
}

Motion& Motion::pass_through(double time_s, std::vector<double> position, std::vector<double> velocity) {
  std::vector<double> from_velocity = segments_.empty() || segments_.back().to_velocity.empty()
                                          ? std::vector<double>(start_.size(), 0.0)
                                          : segments_.back().to_velocity;
  if (time_s > end_s_)
    segments_.push_back({end_s_, time_s - end_s_, 0, last_, position, std::move(from_velocity), std::move(velocity)});
  end_s_ = time_s;
  last_ = std::move(position);
  return *this;
}

Motion& Motion::then(const Motion& other) {
  for (Segment s : other.segments_) {
    s.start_s += end_s_;
    segments_.push_back(std::move(s));
  }
  end_s_ += other.end_s_;
  last_ = other.last_;
  return *this;
}

Motion& Motion::repeat(double timestep_s) {
  period_s_ = std::ceil(end_s_ / timestep_s - 1e-6) * timestep_s;
  dwell(period_s_ - end_s_);
  return *this;
}

std::pair<double, double> Motion::reach_rad(std::size_t joint) const {
  std::pair reach{start_[joint], start_[joint]};
  for (const Segment& s : segments_)
    for (const double q : {s.from[joint], s.to[joint]}) reach = {std::min(reach.first, q), std::max(reach.second, q)};
  return reach;
}

double Motion::Segment::peak_rad_s(std::size_t joint) const {
  const double way = to[joint] - from[joint];
  if (to_velocity.empty()) return way == 0 ? 0 : std::abs(way) / (duration_s - ramp_s);
  // Of a cubic, whose speed is a parabola: at both ends, and at its top where that lies between.
  const double v0 = from_velocity[joint], v1 = to_velocity[joint], mean = way / duration_s, bend = v0 + v1 - 2 * mean,
               top = bend == 0 ? 0 : (2 * v0 + v1 - 3 * mean) / (3 * bend);
  const double between = top > 0 && top < 1 ? v0 - 3 * bend * top * top : 0;
  return std::max({std::abs(v0), std::abs(v1), std::abs(between)});
}

std::vector<Motion::Pace> Motion::paces(std::size_t joint) const {
  // Jumps between the segments, from the start on.
  std::vector<double> jump;
  double last = start_[joint];
  for (const Segment& s : segments_) jump.push_back(s.from[joint] - std::exchange(last, s.to[joint]));
  std::vector<Pace> found;
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    const Segment& s = segments_[i];
    const double since_s = i > 0 ? s.start_s - segments_[i - 1].start_s : s.start_s;
    const auto goes_on = [&](std::size_t other) { return other < jump.size() && jump[i] * jump[other] > 0; };
    if (since_s > 0 && (goes_on(i - 1) || goes_on(i + 1))) found.push_back({since_s, std::abs(jump[i]) / since_s});
    if (const double peak = s.peak_rad_s(joint); peak > 0) found.push_back({s.duration_s, peak});
  }
  return found;
}

void Motion::at(double t, std::span<SetPoint> out) const {
  if (period_s_ > 0) t = std::fmod(t, period_s_);
  const auto after = std::ranges::upper_bound(segments_, t, {}, &Segment::start_s);
  if (after == segments_.begin()) {
    for (std::size_t j = 0; j < start_.size(); ++j) out[j] = {start_[j], 0};
    return;
  }
  const Segment& s = *std::prev(after);
  const double u = t - s.start_s;
  if (u >= s.duration_s || !s.held_velocity.empty() || !s.held_torque.empty()) {
    const auto of = [](const std::vector<double>& held, std::size_t j) { return held.empty() ? 0 : held[j]; };
    for (std::size_t j = 0; j < start_.size(); ++j) out[j] = {s.to[j], of(s.held_velocity, j), of(s.held_torque, j)};
    return;
  }
  if (!s.to_velocity.empty()) {
    const double x = u / s.duration_s, h01 = x * x * (3 - 2 * x), h10 = x * (1 - x) * (1 - x), h11 = x * x * (x - 1);
    for (std::size_t j = 0; j < start_.size(); ++j) {
      const double way = s.to[j] - s.from[j], v0 = s.from_velocity[j], v1 = s.to_velocity[j];
      out[j] = {s.from[j] + h01 * way + s.duration_s * (h10 * v0 + h11 * v1),
                6 * x * (1 - x) * way / s.duration_s + (1 - x) * (1 - 3 * x) * v0 + x * (3 * x - 2) * v1};
    }
    return;
  }
  // Share of the way and its rate: unit distance, plateau speed 1 / (duration - ramp).
  const double plateau = 1 / (s.duration_s - s.ramp_s);
  double way, rate;
  if (u < s.ramp_s) {
    way = plateau * u * u / (2 * s.ramp_s);
    rate = plateau * u / s.ramp_s;
  } else if (u <= s.duration_s - s.ramp_s) {
    way = plateau * (u - s.ramp_s / 2);
    rate = plateau;
  } else {
    const double left = s.duration_s - u;
    way = 1 - plateau * left * left / (2 * s.ramp_s);
    rate = plateau * left / s.ramp_s;
  }
  for (std::size_t j = 0; j < start_.size(); ++j) {
    const double distance = s.to[j] - s.from[j];
    out[j] = {s.from[j] + way * distance, rate * distance};
  }
}

Motion back_and_forth(std::vector<double> centre, std::size_t joint, double travel, double speed, double acceleration,
                      double dwell_s) {
  std::vector<double> low = centre, high = centre;
  low[joint] -= travel / 2;
  high[joint] += travel / 2;
  const std::vector<double> speeds(centre.size(), speed), accelerations(centre.size(), acceleration);
  Motion motion(low);
  motion.move_to(high, speeds, accelerations).dwell(dwell_s).move_to(low, speeds, accelerations).dwell(dwell_s);
  return motion;
}

Motion test_cycle(std::vector<double> centre, std::span<const std::size_t> joints, double acceleration,
                  double dwell_s) {
  constexpr double deg = std::numbers::pi / 180;
  constexpr struct {
    double speed, travel;
  } levels[] = {{0.1, 2},  {0.5, 6},  {1, 15},   {1.5, 15}, {2, 30},   {3, 30},   {5, 60},   {8, 120},
                {10, 120}, {15, 180}, {30, 240}, {45, 360}, {60, 360}, {80, 360}, {100, 360}};
  const std::vector<double> accelerations(centre.size(), acceleration), approach(centre.size(), 60 * deg);
  Motion motion(centre);
  for (const std::size_t joint : joints) {
    for (const auto& level : levels) {
      std::vector<double> low = centre, high = centre;
      low[joint] -= level.travel * deg / 2;
      high[joint] += level.travel * deg / 2;
      const std::vector<double> speeds(centre.size(), level.speed * deg);
      motion.move_to(low, approach, accelerations).dwell(dwell_s);
      motion.move_to(high, speeds, accelerations).dwell(dwell_s).move_to(low, speeds, accelerations).dwell(dwell_s);
    }
    motion.move_to(centre, approach, accelerations).dwell(dwell_s);
  }
  return motion;
}

}  // namespace tribotwin::twin
