#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/render/report/run/histories.hpp>
#include <tribotwin/render/report/run/traces.hpp>
#include <tribotwin/render/theme/theme.hpp>
#include <tribotwin/twin/numerics/median.hpp>

namespace tribotwin::render {

namespace {

std::string friction_name(const std::string& unit) { return unit == "Nm" ? "friction torque" : "friction"; }

/// Whether the run is multi-rate and has values of every work cycle.
bool has_cycles(const RunData& run) { return run.record.cycle_time_s.size() > 1; }

/// A value of every work cycle; empty where the record does not have it.
std::span<const double> cycle_channel(const RunData& run, std::size_t joint, std::string_view name) {
  const auto& channels = run.record.cycle_channels;
  for (std::size_t c = 0; c < channels.size(); ++c)
    if (channels[c].name == name) return run.record.cycle_values[joint][c];
  return {};
}

/// The curves that `trace` makes of the joints, without those that have no finite value.
std::vector<Trace> of_joints(const RunData& run, auto trace) {
  std::vector<Trace> traces;
  for (std::size_t i = 0; i < run.joints.size(); ++i)
    if (std::optional<Trace> t = trace(i, run.joints[i]); t && any_finite(*t)) traces.push_back(std::move(*t));
  return traces;
}

std::optional<Drawing> drawing(const Axis& axis, const std::vector<Trace>& traces, std::string caption) {
  if (traces.empty()) return std::nullopt;
  return Drawing{history("", axis, traces), std::move(caption)};
}

std::optional<Drawing> temperature(const RunData& run) {
  const auto& r = run.record;
  const auto traces = of_joints(run, [&](std::size_t i, const JointHistory& j) -> std::optional<Trace> {
    return has_cycles(run) ? envelope(j.name, r.cycle_time_s, cycle_channel(run, i, "cycle_temperature_degC"))
                           : envelope(j.name, r.time_s, j.temperature_degC);
  });
  return drawing(lubricant_temperature(), traces, "Lubricant temperature of each joint.");
}

std::optional<Drawing> friction_power(const RunData& run) {
  if (!has_cycles(run)) return std::nullopt;
  const auto traces = of_joints(run, [&](std::size_t i, const JointHistory& j) -> std::optional<Trace> {
    if (!j.moved) return std::nullopt;
    return envelope(j.name, run.record.cycle_time_s, cycle_channel(run, i, "cycle_friction_power_W"));
  });
  return drawing({.quantity = "friction power", .symbol = "{/:Italic P}", .unit = "W"}, traces,
                 "Mean friction power of each work cycle, for the joints that moved.");
}

std::optional<Drawing> friction_torque(const RunData& run) {
  if (has_cycles(run)) return std::nullopt;
  const auto& time = run.record.time_s;
  const double window_s = (time.back() - time.front()) / 300;
  const auto traces = of_joints(run, [&](std::size_t, const JointHistory& j) -> std::optional<Trace> {
    if (!j.moved) return std::nullopt;
    return window_s > 0 ? rms_trace(j.name, time, j.friction_nm, window_s) : envelope(j.name, time, j.friction_nm);
  });
  const std::string unit = force_unit(run.joints, [](const JointHistory& j) { return j.moved; });
  return drawing({.quantity = friction_name(unit) + ", RMS", .symbol = "{/:Italic τ}_f", .unit = unit}, traces,
                 fmt::format("Friction, root mean square over {}, for the joints that moved.", duration(window_s)));
}

using Stretch = std::pair<std::size_t, std::size_t>;  // first sample, and the one after the last

/// Spans of samples without a gap in time: the work cycles that a multi-rate run computed.
std::vector<Stretch> stretches(std::span<const double> time) {
  std::vector<Stretch> out;
  if (time.size() < 3) return out;
  std::vector<double> steps;
  for (std::size_t i = 1; i < time.size(); ++i) steps.push_back(time[i] - time[i - 1]);
  const double usual = twin::identification::median_of(std::move(steps));
  std::size_t begin = 0;
  for (std::size_t i = 1; i <= time.size(); ++i)
    if (i == time.size() || time[i] - time[i - 1] > 1.5 * usual) {
      if (i - begin > 2) out.emplace_back(begin, i);
      begin = i;
    }
  return out;
}

/// The joint whose temperature rose most, by more than 1 K.
const JointHistory* most_warmed(const RunData& run) {
  const JointHistory* best = nullptr;
  double rise_max = 1;
  for (const auto& j : run.joints)
    if (j.moved && !j.temperature_degC.empty() && j.temperature_degC.back() - j.temperature_degC.front() > rise_max)
      rise_max = j.temperature_degC.back() - j.temperature_degC.front(), best = &j;
  return best;
}

/// Friction over the first and the last work cycle.
std::optional<Drawing> cold_and_warm(const RunData& run) {
  const auto& time = run.record.time_s;
  const auto all = stretches(time);
  const JointHistory* joint = most_warmed(run);
  if (all.size() < 2 || !joint || joint->friction_nm.empty()) return std::nullopt;
  const auto seconds = [&](const Stretch& stretch) { return time[stretch.second - 1] - time[stretch.first]; };
  const double length = std::min(seconds(all.front()), seconds(all.back()));
  std::vector<Trace> traces;
  for (const auto& [begin, end] : {all.front(), all.back()}) {
    Trace t{fmt::format("{:.1f} °C, after {}", joint->temperature_degC[begin], duration(time[begin])), {}, {}};
    for (std::size_t i = begin; i < end && time[i] - time[begin] <= length; ++i) {
      t.time_s.push_back(time[i] - time[begin]);
      t.values.push_back(joint->friction_nm[i]);
    }
    if (any_finite(t)) traces.push_back(std::move(t));
  }
  const std::string unit = joint->slide ? "N" : "Nm";
  return drawing({.quantity = friction_name(unit), .symbol = "{/:Italic τ}_f", .unit = unit}, traces,
                 fmt::format("{}: the same motion at the beginning and at the end of the run.", joint->name));
}

Axis recording_axis() { return {.quantity = "recorded − simulated position", .unit = "mrad"}; }

/// Recorded minus simulated position [rad], where the scenario replays a recording that measured it.
std::optional<Trace> recording_error(const RunData& run) {
  if (!run.scenario || !run.scenario->recording || run.scenario->recording->measured_rad.empty() || run.joints.empty())
    return std::nullopt;
  const auto& set = *run.scenario->recording;
  const auto& q = run.joints[0].position_rad;
  const auto& time = run.record.time_s;
  Trace error{"twin", {}, {}};
  for (std::size_t i = 0; i < set.time_s.size(); ++i) {
    const auto after = std::ranges::lower_bound(time, set.time_s[i]);
    if (after == time.begin() || after == time.end()) continue;
    const std::size_t k = static_cast<std::size_t>(after - time.begin());
    const double w = (set.time_s[i] - time[k - 1]) / (time[k] - time[k - 1]);
    error.time_s.push_back(set.time_s[i]);
    error.values.push_back(set.measured_rad[0][i] - (q[k - 1] + w * (q[k] - q[k - 1])));
  }
  return any_finite(error) ? std::optional(std::move(error)) : std::nullopt;
}

std::optional<Drawing> recording_error_over_time(const RunData& run) {
  const auto error = recording_error(run);
  if (!error) return std::nullopt;
  Drawing d{tracking_error("", std::array{*error}), "Recorded minus simulated joint position."};
  d.figure.y = recording_axis();
  return d;
}

std::optional<Drawing> recording_error_histogram(const RunData& run) {
  const auto error = recording_error(run);
  if (!error) return std::nullopt;
  std::vector<double> mrad;
  for (const double e : error->values) mrad.push_back(1e3 * e);
  return Drawing{residual_histogram("", recording_axis(), mrad),
                 "How often each error occurs, with the normal distribution of the same mean and deviation."};
}

constexpr FigureRow<RunData> table[] = {
    {"temperature", "Temperature", temperature},
    {"friction", "Friction power", friction_power},
    {"friction", "Friction torque", friction_torque},
    {"cold_and_warm", "Cold and warm", cold_and_warm},
    {"recording_error", "Recording against twin", recording_error_over_time},
    {"recording_error_histogram", "Recording against twin", recording_error_histogram},
};

}  // namespace

Axis lubricant_temperature() { return {.quantity = "lubricant temperature", .symbol = "{/:Italic T}", .unit = "°C"}; }

std::span<const FigureRow<RunData>> history_figures() { return table; }

}  // namespace tribotwin::render
