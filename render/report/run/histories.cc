#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/render/report/record/cycles.hpp>
#include <tribotwin/render/report/record/traces.hpp>
#include <tribotwin/render/report/run/histories.hpp>
#include <tribotwin/render/report/run/run_summary.hpp>
#include <tribotwin/render/theme/theme.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::render {

namespace {

constexpr std::size_t edge_stroke = 5;  ///< of the edges of laws: grey

std::string friction_name(const std::string& unit) { return unit == "Nm" ? "friction torque" : "friction"; }

/// The curves that `trace` makes of the joints, without those that have no finite value.
std::vector<Trace> of_joints(const RunData& run, auto trace) {
  std::vector<Trace> traces;
  for (std::size_t i = 0; i < run.joints.size(); ++i)
    if (std::optional<Trace> t = trace(i, run.joints[i]); t && any_finite(*t)) {
      t->stroke = i;  // a joint has the same colour in all figures
      traces.push_back(std::move(*t));
    }
  return traces;
}

std::optional<Drawing> drawing(const Axis& axis, const std::vector<Trace>& traces, std::string caption) {
  if (traces.empty()) return std::nullopt;
  return Drawing{history("", axis, traces), std::move(caption)};
}

/// Its samples; nullptr where no joint warmed, or it has no temperatures.
const JointHistory* most_warmed(const RunData& run) {
  const auto joints = joint_summaries(run);
  const JointSummary* hot = most_warmed(run, joints);
  const auto joint = hot ? std::ranges::find(run.joints, hot->name, &JointHistory::name) : run.joints.end();
  return joint == run.joints.end() || joint->temperature_degC.empty() ? nullptr : &*joint;
}

/// The edge of a law's range that a joint's temperature crosses, and when.
struct Crossing {
  const JointHistory* joint;
  double edge_degC, time_s;
};

/// Of the joint that warms most: below the edge its friction is that at the edge.
std::optional<Crossing> crossing(const RunData& run) {
  const JointHistory* joint = most_warmed(run);
  if (!joint || !run.model()) return std::nullopt;
  const auto index = twin::find_drive(*run.model(), joint->name);
  if (!index) return std::nullopt;
  const auto& law = run.model()->drives()[*index].drive.law;
  const double edge = law.range.temperature_min_degC;
  if (!law.info->temperature_dependent || law.validity != friction::Validity::clamp) return std::nullopt;
  // All values, not the curve of the figure, which has few of them.
  const auto& record = run.record;
  const std::span<const double> time = has_cycles(run) ? std::span(record.cycle_time_s) : std::span(record.time_s),
                                degC = has_cycles(run) ? record.channel(joint->name, "cycle_temperature_degC")
                                                       : joint->temperature_degC;
  for (std::size_t i = 1; i < std::min(time.size(), degC.size()); ++i)
    if (degC[i - 1] < edge && degC[i] >= edge)
      return Crossing{joint, edge,
                      time[i - 1] + (time[i] - time[i - 1]) * (edge - degC[i - 1]) / (degC[i] - degC[i - 1])};
  return std::nullopt;
}

std::string clamped_until(const Crossing& c) {
  return fmt::format(
      " Grey, dashed: below {:.0f} °C the law of {} was not measured; until {} its friction is that at {:.0f} °C.",
      c.edge_degC, c.joint->name, duration(c.time_s), c.edge_degC);
}

/// The moment of a crossing as a vertical line through the traces.
Trace moment_line(const Crossing& c, const std::vector<Trace>& traces) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const Trace& t : traces)
    for (const double v : t.values)
      if (std::isfinite(v)) low = std::min(low, v), high = std::max(high, v);
  return {"", {c.time_s, c.time_s}, {low, high}, edge_stroke, Mark::reference};
}

std::optional<Drawing> temperature(const RunData& run) {
  auto traces = of_joints(
      run, [&](std::size_t, const JointHistory& j) { return std::optional(lubricant_temperature(j.name, run, j)); });
  std::string caption = "Lubricant temperature of each joint.";
  if (const auto c = crossing(run); c && !traces.empty()) {
    const double end_s = has_cycles(run) ? run.record.cycle_time_s.back() : run.record.time_s.back();
    traces.push_back({"", {0, end_s}, {c->edge_degC, c->edge_degC}, edge_stroke, Mark::reference});
    caption += clamped_until(*c);
  }
  return drawing(lubricant_temperature(), traces, std::move(caption));
}

std::optional<Drawing> winding_temperature(const RunData& run) {
  const auto traces = of_joints(run, [&](std::size_t, const JointHistory& j) -> std::optional<Trace> {
    Trace t = envelope(j.name, run.record.time_s, j.winding_degC);
    return any_finite(t) ? std::optional(std::move(t)) : std::nullopt;
  });
  return drawing({.quantity = "winding temperature", .symbol = "{/:Italic T}_w", .unit = "°C"}, traces,
                 "Temperature of the motors' windings.");
}

std::optional<Drawing> friction_power_of_joints(const RunData& run) {
  if (!has_cycles(run)) return std::nullopt;
  auto traces = of_joints(run, [&](std::size_t, const JointHistory& j) -> std::optional<Trace> {
    return j.moved ? std::optional(friction_power(j.name, run, j)) : std::nullopt;
  });
  std::string caption = "Mean friction power of each work cycle, for the joints that moved.";
  if (const auto c = crossing(run); c && !traces.empty()) {
    traces.push_back(moment_line(*c, traces));
    caption += clamped_until(*c);
  }
  return drawing({.quantity = "friction power", .symbol = "{/:Italic P}", .unit = "W"}, traces, std::move(caption));
}

std::optional<Drawing> friction_torque(const RunData& run) {
  if (has_cycles(run)) return std::nullopt;
  const auto traces = of_joints(run, [&](std::size_t, const JointHistory& j) -> std::optional<Trace> {
    return j.moved ? std::optional(friction_rms(j.name, run, j)) : std::nullopt;
  });
  const std::string unit = force_unit(run.joints, [](const JointHistory& j) { return j.moved; });
  return drawing({.quantity = friction_name(unit) + ", RMS", .symbol = "{/:Italic τ}_f", .unit = unit}, traces,
                 fmt::format("Friction of the joints that moved, {}.", friction_rms_caption(run)));
}

/// Friction over the first and the last work cycle.
std::optional<Drawing> cold_and_warm(const RunData& run) {
  const auto& time = run.record.time_s;
  const auto all = complete_cycles(run);
  const JointHistory* joint = most_warmed(run);
  if (all.size() < 2 || !joint || joint->friction_nm.empty()) return std::nullopt;
  std::vector<Trace> traces;
  for (const CompleteCycle& cycle : {all.front(), all.back()}) {
    Trace t{fmt::format("{:.1f} °C, after {}", joint->temperature_degC[cycle.begin], duration(time[cycle.begin])),
            {},
            {},
            traces.size()};
    for (std::size_t i = cycle.begin; i < cycle.end; ++i) {
      t.time_s.push_back(time[i] - time[cycle.begin]);
      t.values.push_back(joint->friction_nm[i]);
    }
    if (any_finite(t)) traces.push_back(std::move(t));
  }
  const std::string unit = joint->slide ? "N" : "Nm";
  auto shown = drawing({.quantity = friction_name(unit), .symbol = "{/:Italic τ}_f", .unit = unit}, traces,
                       fmt::format("{}: the same motion at the beginning and at the end of the run.", joint->name));
  if (shown) shown->figure.x.quantity = "time in the cycle";
  return shown;
}

/// " of a.json"; nothing where it has no name.
std::string of_recording(const RunData& run) {
  const std::string file = run.recording_file();
  return file.empty() ? "" : " of " + file;
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
  Drawing d{tracking_error("", std::array{*error}),
            fmt::format("Recorded minus simulated joint position{}.", of_recording(run))};
  d.figure.y = recording_axis();
  return d;
}

std::optional<Drawing> recording_error_histogram(const RunData& run) {
  const auto error = recording_error(run);
  if (!error) return std::nullopt;
  std::vector<double> mrad;
  for (const double e : error->values) mrad.push_back(1e3 * e);
  return Drawing{residual_histogram("", recording_axis(), mrad),
                 fmt::format("How often each error{} occurs, with the normal distribution of the same mean and "
                             "deviation.",
                             of_recording(run))};
}

constexpr FigureRow<RunData> table[] = {
    {"temperature", "Temperature", temperature},
    {"winding_temperature", "Winding temperature", winding_temperature},
    {"friction", "Friction power", friction_power_of_joints},
    {"friction", "Friction torque", friction_torque},
    {"cold_and_warm", "Cold and warm", cold_and_warm},
    {"recording_error", "Recording against twin, over time", recording_error_over_time},
    {"recording_error_histogram", "Recording against twin, how often", recording_error_histogram},
};

}  // namespace

Axis lubricant_temperature() { return {.quantity = "lubricant temperature", .symbol = "{/:Italic T}", .unit = "°C"}; }

std::span<const FigureRow<RunData>> history_figures() { return table; }

}  // namespace tribotwin::render
