#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <tribotwin/render/report/record/traces.hpp>
#include <tribotwin/render/report/run/run_summary.hpp>
#include <tribotwin/render/report/run/transmissions.hpp>

namespace tribotwin::render {
namespace {

constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

std::optional<Drawing> loop(const RunData& run, const JointHistory& j) {
  return Drawing{loop_figure(std::array{last_loop("", run, j)}),
                 "The last period of the load, or the whole run where the load has none."};
}

std::optional<Drawing> set_point(const RunData& run, const JointHistory& j) {
  if (!arm_error("", run, j)) return std::nullopt;
  const auto& time = run.record.time_s;
  return Drawing{
      history("", {.quantity = "arm position", .symbol = "{/:Italic q}", .unit = "rad"},
              std::array{envelope("set point", time, j.arm_set_point_rad), envelope("arm", time, j.arm_position_rad)}),
      "Angle behind the transmission and its set point."};
}

std::optional<Drawing> error_of_arm(const RunData& run, const JointHistory& j) {
  const auto error = arm_error("", run, j);
  if (!error) return std::nullopt;
  return Drawing{tracking_error("", std::array{*error}), "Set point minus angle behind the transmission."};
}

constexpr FigureRow<RunData, JointHistory> table[] = {
    {"loop", "torque over torsion", loop},
    {"set_point", "arm and set point", set_point},
    {"tracking_error", "tracking error", error_of_arm},
};

}  // namespace

bool has_transmission(const JointHistory& j) {
  return !j.transmission_torque_nm.empty() &&
         std::ranges::any_of(j.torsion_rad, [](double v) { return std::isfinite(v); });
}

Loop last_loop(std::string label, const RunData& run, const JointHistory& j) {
  const auto& time = run.record.time_s;
  double period_s = std::numeric_limits<double>::infinity();
  for (const auto& loop : entries(run, "loops")) period_s = 1 / number(loop, {"frequency_hz"});
  // Includes the sample at which the period began, whatever its time was rounded to, so that the loop closes.
  const auto first = static_cast<std::size_t>(
      std::ranges::find_if(time, [&](double t) { return !(t < time.back() - period_s * (1 + 1e-9)); }) - time.begin());
  Trace t = envelope(std::move(label), j.torsion_rad.subspan(first), j.transmission_torque_nm.subspan(first));
  for (double& torsion : t.time_s) torsion *= 1e3;
  return {std::move(t.label), std::move(t.time_s), std::move(t.values)};
}

Figure loop_figure(std::span<const Loop> loops) {
  return hysteresis_loop("", {.quantity = "torsion", .symbol = "{/:Italic φ}", .unit = "mrad"},
                         {.quantity = "torque of the transmission", .symbol = "{/:Italic τ}", .unit = "Nm"}, loops);
}

std::optional<Trace> arm_error(std::string label, const RunData& run, const JointHistory& j) {
  const auto moves = [first = j.arm_set_point_rad.empty() ? unknown : j.arm_set_point_rad.front()](double q) {
    return std::abs(q - first) > 0;
  };
  if (j.arm_position_rad.empty() || std::ranges::none_of(j.arm_set_point_rad, moves)) return std::nullopt;
  std::vector<double> error;
  for (std::size_t i = 0; i < j.arm_set_point_rad.size(); ++i)
    error.push_back(j.arm_set_point_rad[i] - j.arm_position_rad[i]);
  Trace trace = envelope(std::move(label), run.record.time_s, error);
  return any_finite(trace) ? std::optional(std::move(trace)) : std::nullopt;
}

std::span<const FigureRow<RunData, JointHistory>> transmission_figures() { return table; }

void add_transmission_tables(IllustratedPage& page, pugi::xml_node to, std::span<const std::unique_ptr<RunData>> runs,
                             const std::function<std::string(const RunData&)>& label) {
  std::vector<std::vector<std::string>> tracking, loops;
  for (const auto& r : runs) {
    for (const auto& e : entries(*r, "tracking")) {
      const double standstill = number(e, {"standstill_pp_mrad"});  // 0: never at rest for long enough
      tracking.push_back({label(*r), shown(number(e, {"temperature_degC"}), "{:.1f}"), text(e, "compensation"),
                          shown(number(e, {"l1_mrad"}), "{:.4f}"),
                          shown(standstill > 0 ? standstill : unknown, "{:.4f}")});
    }
    for (const auto& e : entries(*r, "loops"))
      loops.push_back({label(*r), shown(number(e, {"temperature_degC"}), "{:.1f}"),
                       shown(number(e, {"frequency_hz"}), "{:g}"), shown(number(e, {"area_J"}), 4),
                       shown(number(e, {"torque_nm"}), 5), shown(number(e, {"stiffness_nm_rad"}) / 1e6, 4)});
  }
  if (!tracking.empty())
    page.add_table(
        to, {"tracking of", "start [°C]", "compensation", "mean |error| [mrad]", "peak to peak at standstill [mrad]"},
        tracking);
  if (!loops.empty())
    page.add_table(
        to,
        {"loop of", "start [°C]", "load [Hz]", "area [J]", "maximum torque [Nm]", "stiffness, end to end [MNm/rad]"},
        loops);
}

}  // namespace tribotwin::render
