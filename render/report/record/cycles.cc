#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include <tribotwin/render/report/record/cycles.hpp>
#include <tribotwin/render/report/record/traces.hpp>
#include <tribotwin/render/theme/theme.hpp>
#include <tribotwin/twin/numerics/median.hpp>

namespace tribotwin::render {
namespace {

/// Of a run whose motion does not repeat; fewer where each would have fewer samples than that.
constexpr double windows = 200, samples_of_window = 5;
/// A cycle of fewer samples says little about its root mean square.
constexpr double samples_min = 20;

double window_of(const RunData& run) {
  const auto& time = run.record.time_s;
  const double span_s = time.back() - time.front();
  const double most = std::floor(span_s / (samples_of_window * twin::identification::median_step(time)));
  return span_s / std::max(1.0, std::min(windows, most));
}

double rms(std::span<const double> values) {
  double squares = 0;
  std::size_t count = 0;
  for (const double v : values)
    if (std::isfinite(v)) squares += v * v, ++count;
  return count ? std::sqrt(squares / static_cast<double>(count)) : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

bool has_cycles(const RunData& run) { return run.record.cycle_time_s.size() > 1; }

std::vector<CompleteCycle> complete_cycles(const RunData& run) {
  std::vector<CompleteCycle> all;
  if (!has_cycles(run) || run.record.time_s.size() < 3) return all;
  const auto& time = run.record.time_s;
  const double period_s = twin::identification::median_step(run.record.cycle_time_s),
               step_s = twin::identification::median_step(time);
  const double expected = period_s / step_s;
  if (!(expected >= samples_min)) return all;
  std::size_t begin = 0;
  for (std::size_t row = 0; row < run.record.cycle_time_s.size(); ++row) {
    const double end_s = run.record.cycle_time_s[row];
    while (begin < time.size() && time[begin] < end_s - period_s - 1e-6 * step_s) ++begin;
    std::size_t end = begin;
    while (end < time.size() && time[end] < end_s - 1e-6 * step_s) ++end;
    if (static_cast<double>(end - begin) >= std::floor(expected) - 0.5)
      all.push_back({begin, end, end_s - period_s / 2, row});
    begin = end;
  }
  return all;
}

Trace lubricant_temperature(std::string label, const RunData& run, const JointHistory& joint) {
  const auto& r = run.record;
  return has_cycles(run)
             ? envelope(std::move(label), r.cycle_time_s, run.record.channel(joint.name, "cycle_temperature_degC"))
             : envelope(std::move(label), r.time_s, joint.temperature_degC);
}

Trace friction_power(std::string label, const RunData& run, const JointHistory& joint) {
  return envelope(std::move(label), run.record.cycle_time_s, run.record.channel(joint.name, "cycle_friction_power_W"));
}

double friction_power_scatter(const RunData& run, const JointHistory& joint) {
  constexpr std::size_t count_min = 5;
  const auto power = run.record.channel(joint.name, "cycle_friction_power_W");
  const auto cycles = complete_cycles(run);
  double squares = 0;
  std::size_t count = 0;
  for (std::size_t i = 1; i + 1 < cycles.size(); ++i) {
    const std::size_t row = cycles[i].row;
    if (cycles[i - 1].row == 0 || cycles[i - 1].row + 1 != row || cycles[i + 1].row != row + 1) continue;
    if (row + 1 >= power.size()) break;
    const double off = power[row] - (power[row - 1] + power[row + 1]) / 2;
    squares += off * off / 1.5, ++count;  // 1 + 1/4 + 1/4 variances
  }
  return count < count_min ? std::numeric_limits<double>::quiet_NaN() : std::sqrt(squares / static_cast<double>(count));
}

Trace friction_rms(std::string label, const RunData& run, const JointHistory& joint) {
  const auto cycles = complete_cycles(run);
  if (cycles.empty() && has_cycles(run)) return {std::move(label), {}, {}};
  if (cycles.empty()) {
    const double window_s = window_of(run);
    return rms_trace(std::move(label), run.record.time_s, joint.friction_nm, window_s > 0 ? window_s : 1);
  }
  std::vector<double> time, values;
  for (const CompleteCycle& c : cycles)
    if (c.end <= joint.friction_nm.size()) {
      time.push_back(c.middle_s);
      values.push_back(rms(joint.friction_nm.subspan(c.begin, c.end - c.begin)));
    }
  return envelope(std::move(label), time, values);
}

std::string friction_rms_caption(const RunData& run) {
  if (has_cycles(run)) return "root mean square over each complete work cycle that was computed";
  if (!(window_of(run) > 0)) return "magnitude of the only sample";
  return fmt::format("root mean square over {}", duration(window_of(run)));
}

}  // namespace tribotwin::render
