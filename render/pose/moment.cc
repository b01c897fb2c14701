#include <algorithm>
#include <cmath>
#include <limits>

#include <tribotwin/render/pose/moment.hpp>
#include <tribotwin/twin/numerics/interpolation.hpp>
#include <tribotwin/twin/numerics/median.hpp>

namespace tribotwin::render {
Moments::Moments(const mujoco::Model& model, const twin::Recording& record)
    : model_(model),
      record_(record),
      rest_(rest(model)),
      step_s_(twin::identification::median_step(record.time_s)),
      period_s_(twin::identification::median_step(record.cycle_time_s)) {}

bool Moments::around(double time_s, Sampled& found) const {
  const auto& time = record_.time_s;
  const auto after = std::ranges::lower_bound(time, time_s - 1e-9 * (1 + std::abs(time_s)));
  if (after == time.end()) return false;
  const auto at = static_cast<std::size_t>(after - time.begin());
  if (at == 0 || *after - time_s < 1e-6 * step_s_) {
    found = {at, at, 0};
    return std::abs(*after - time_s) <= step_s_;
  }
  found = {at - 1, at, (time_s - time[at - 1]) / (time[at] - time[at - 1])};
  return time[at] - time[at - 1] <= 1.5 * step_s_;
}

PoseState Moments::sampled(const Sampled& s, double time_s) const {
  const PoseState before = recorded(model_, record_, s.before, rest_);
  if (s.before != s.after) return between(before, recorded(model_, record_, s.after, rest_), s.weight, time_s);
  return between(before, before, 0, time_s);
}

PoseState Moments::between(const PoseState& a, const PoseState& b, double w, double time_s) const {
  PoseState state = a;
  state.time_s = time_s;
  const auto mean = [w](double x, double y) { return (1 - w) * x + w * y; };
  for (std::size_t i = 0; i < state.qpos.size(); ++i) state.qpos[i] = mean(a.qpos[i], b.qpos[i]);
  for (std::size_t i = 0; i < state.joints.size(); ++i) {
    state.joints[i].temperature_degC = mean(a.joints[i].temperature_degC, b.joints[i].temperature_degC);
    state.joints[i].friction_nm = mean(a.joints[i].friction_nm, b.joints[i].friction_nm);
  }
  return state;
}

double Moments::cycle_temperature(const std::string& joint, double time_s) const {
  const auto& time = record_.cycle_time_s;
  const auto values = record_.channel(joint, "cycle_temperature_degC");
  if (values.size() != time.size() || time.empty()) return std::numeric_limits<double>::quiet_NaN();
  return twin::between_samples(time, values, time_s);
}

PoseState Moments::at(double time_s) const {
  Sampled here{};
  if (around(time_s, here)) return sampled(here, time_s);
  // The same moment of the computed cycles before and after.
  Sampled earlier{}, later{};
  double before_s = time_s - period_s_, after_s = time_s + period_s_;
  while (period_s_ > 0 && before_s >= begin_s() && !around(before_s, earlier)) before_s -= period_s_;
  while (period_s_ > 0 && after_s <= end_s() && !around(after_s, later)) after_s += period_s_;
  const bool has_before = period_s_ > 0 && before_s >= begin_s(), has_after = period_s_ > 0 && after_s <= end_s();
  if (!has_before && !has_after)
    return recorded(model_, record_, std::min(here.after, record_.time_s.size() - 1), rest_);
  PoseState found = !has_after    ? sampled(earlier, before_s)
                    : !has_before ? sampled(later, after_s)
                                  : between(sampled(earlier, before_s), sampled(later, after_s),
                                            (time_s - before_s) / (after_s - before_s), time_s);
  found.time_s = time_s;
  for (JointState& joint : found.joints)
    if (const double T = cycle_temperature(joint.name, time_s); std::isfinite(T)) joint.temperature_degC = T;
  return found;
}

std::vector<PoseState> Moments::evenly(std::size_t count) const {
  std::vector<PoseState> states;
  for (std::size_t i = 0; i < count; ++i) {
    const double share = count == 1 ? 1 : static_cast<double>(i) / static_cast<double>(count - 1);
    states.push_back(at(begin_s() + share * (end_s() - begin_s())));
    if (end_s() == begin_s()) break;
  }
  return states;
}

std::vector<double> Moments::film_times(std::size_t frames, std::size_t cycle_frames) const {
  constexpr double frames_per_cycle_min = 8;  // fewer show no motion
  std::vector<double> times;
  const double span_s = end_s() - begin_s(), cycles = period_s_ > 0 ? std::floor(span_s / period_s_) : 0;
  if (cycles < 2 || frames < 4 || static_cast<double>(frames) >= frames_per_cycle_min * cycles) {
    for (std::size_t i = 0; i < frames; ++i)
      times.push_back(begin_s() +
                      span_s * (frames > 1 ? static_cast<double>(i) / static_cast<double>(frames - 1) : 1.0));
    return times;
  }
  const std::size_t moments =
      std::clamp<std::size_t>(frames / std::max<std::size_t>(1, cycle_frames), 2, static_cast<std::size_t>(cycles));
  for (std::size_t i = 0; i < frames; ++i) {
    const double at = static_cast<double>(i) * static_cast<double>(moments) / static_cast<double>(frames);
    const double moment = std::floor(at);
    const double cycle = std::round(moment * (cycles - 1) / static_cast<double>(moments - 1));
    times.push_back(begin_s() + (cycle + at - moment) * period_s_);
  }
  return times;
}

std::vector<double> Moments::strobe_times(std::size_t count, std::size_t per_cycle) const {
  std::vector<double> times;
  const double step_s = (end_s() - begin_s()) / static_cast<double>(count - 1);
  const bool fast = period_s_ > 0 && step_s >= period_s_;
  for (std::size_t i = 0; i + 1 < count; ++i) {
    const double even_s = static_cast<double>(i) * step_s,
                 share = static_cast<double>(i % per_cycle) / static_cast<double>(per_cycle);
    times.push_back(begin_s() + (fast ? (std::floor(even_s / period_s_) + share) * period_s_ : even_s));
  }
  times.push_back(end_s());
  return times;
}

}  // namespace tribotwin::render
