#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/render/report/run/comparison.hpp>
#include <tribotwin/render/report/run/histories.hpp>
#include <tribotwin/render/report/run/run_summary.hpp>
#include <tribotwin/render/report/run/traces.hpp>
#include <tribotwin/render/report/run/transmissions.hpp>

namespace tribotwin::render {
namespace {

constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

/// Removes the columns, but the first, that no run has a value for.
void remove_unknown(std::vector<std::string>& head, std::vector<std::vector<std::string>>& rows) {
  for (std::size_t column = head.size(); column-- > 1;) {
    const auto at = static_cast<std::ptrdiff_t>(column);
    if (!std::ranges::all_of(rows, [column](const auto& row) { return row[column] == "–"; })) continue;
    head.erase(head.begin() + at);
    for (auto& row : rows) row.erase(row.begin() + at);
  }
}

std::string unit_of_all(const Runs& runs) {
  std::vector<JointHistory> all;
  for (const auto& run : runs.all) all.insert(all.end(), run->joints.begin(), run->joints.end());
  return force_unit(all, [](const JointHistory&) { return true; });
}

void add_table(IllustratedPage& page, const Runs& runs) {
  const std::string unit = unit_of_all(runs);
  std::vector<std::string> head{"run",
                                "simulated [s]",
                                "warmest joint",
                                "maximum temperature [°C]",
                                "friction work [kJ]",
                                "motor work [kJ]",
                                fmt::format("maximum friction [{}]", unit),
                                "maximum load [-]",
                                "error against recording [mrad]",
                                "engine",
                                "seed"};
  std::vector<std::vector<std::string>> rows;
  for (const auto& r : runs.all) {
    const auto joints = joint_summaries(*r);
    const auto* hot = warmest(joints);
    double nm = unknown, load = unknown;
    for (const auto& j : joints) nm = std::fmax(nm, j.friction_max_nm), load = std::fmax(load, j.load_max);
    rows.push_back({runs.label(*r), shown(simulated_s(*r), "{:.1f}"), hot ? hot->name : "",
                    hot ? shown(hot->max_degC, "{:.2f}") : "",
                    shown(number(r->summary, {"friction_work_J"}) / 1e3, "{:.5g}"),
                    shown(number(r->summary, {"motor_work_J"}) / 1e3, "{:.5g}"), shown(nm, "{:.4g}"),
                    shown(load, "{:.3f}"), shown(number(r->summary, {"comparison", "mae_mrad"}), "{:.1f}"),
                    "MuJoCo " + r->attribute("engine_version"), r->attribute("seed")});
  }
  remove_unknown(head, rows);
  page.add_table(page.body(), head, rows);
}

/// A curve of the warmest joint of each run that `trace` has values for.
std::optional<Drawing> of_warmest(const Runs& runs, const Axis& axis, std::string caption, auto trace) {
  std::vector<Trace> traces;
  for (const auto& r : runs.all) {
    const auto joints = joint_summaries(*r);
    const auto* hot = warmest(joints);
    for (const auto& j : r->joints)
      if (hot && j.name == hot->name)
        if (std::optional<Trace> t = trace(runs.label(*r) + ", " + j.name, *r, j); t && any_finite(*t))
          traces.push_back(std::move(*t));
  }
  if (traces.empty()) return std::nullopt;
  return Drawing{history("", axis, traces), std::move(caption)};
}

std::optional<Drawing> temperature(const Runs& runs) {
  return of_warmest(runs, lubricant_temperature(), "The warmest joint of each run.",
                    [](std::string label, const RunData& run, const JointHistory& j) -> std::optional<Trace> {
                      return envelope(std::move(label), run.record.time_s, j.temperature_degC);
                    });
}

std::optional<Drawing> friction(const Runs& runs) {
  return of_warmest(runs, {.quantity = "friction, RMS", .symbol = "{/:Italic τ}_f", .unit = unit_of_all(runs)},
                    "The same joints: friction, root mean square over 1/200 of the run.",
                    [](std::string label, const RunData& run, const JointHistory& j) -> std::optional<Trace> {
                      const auto& time = run.record.time_s;
                      const double window_s = (time.back() - time.front()) / 200;
                      if (!(window_s > 0)) return std::nullopt;
                      return rms_trace(std::move(label), time, j.friction_nm, window_s);
                    });
}

constexpr FigureRow<Runs> table[] = {
    {"compared_temperature", "Warmest joints", temperature},
    {"compared_friction", "Friction of the warmest joints", friction},
};

/// Loops and tracking errors of all runs that have a transmission.
struct Transmissions {
  std::vector<Loop> loops;
  std::vector<std::pair<std::string, std::vector<Trace>>> errors;  ///< by the temperature at the start
};

Transmissions transmissions_of(const Runs& runs) {
  Transmissions t;
  for (const auto& r : runs.all)
    for (const auto& j : r->joints) {
      if (!has_transmission(j)) continue;
      const std::string name = r->joints.size() > 1 ? runs.label(*r) + ", " + j.name : runs.label(*r);
      t.loops.push_back(last_loop(name, *r, j));
      auto error = arm_error(name, *r, j);
      if (!error) continue;
      const std::string start = shown(j.temperature_degC.empty() ? unknown : j.temperature_degC.front(), "{:.1f} °C");
      auto group = std::ranges::find(t.errors, start, &decltype(t.errors)::value_type::first);
      if (group == t.errors.end()) group = t.errors.insert(group, {start, {}});
      group->second.push_back(std::move(*error));
    }
  return t;
}

/// The loops of all runs in one figure; their tracking errors in one for each temperature at the start.
Result<void> add_transmissions(IllustratedPage& page, const Runs& runs) {
  const Transmissions t = transmissions_of(runs);
  if (t.loops.empty()) return {};
  page.add(page.body(), "h3", "Transmissions");
  auto grid = page.add(page.body(), "div", {}, "figures");
  Figure loops = loop_figure(t.loops);
  loops.title = "Torque over torsion";
  if (auto ok = page.show(grid, loops, "compared_loops",
                          "The last period of each load, or the whole run where the load has none.");
      !ok)
    return ok;
  for (const auto& [start, traces] : t.errors)
    if (auto ok = page.show(grid, tracking_error("Tracking error from " + start, traces), "compared_tracking_error",
                            "Set point minus angle behind the transmission.");
        !ok)
      return ok;
  add_transmission_tables(page, page.body(), runs.all, [&](const RunData& run) { return runs.label(run); });
  return {};
}

}  // namespace

std::string Runs::title() const {
  if (all.size() == 1) return all[0]->name;
  const std::string scenario = all[0]->attribute("scenario");
  const bool one_scenario = !scenario.empty() && std::ranges::all_of(all, [&](const auto& r) {
    return r->attribute("scenario") == scenario;
  });
  return fmt::format("{}{} runs compared", one_scenario ? scenario + ": " : "", all.size());
}

std::string Runs::label(const RunData& run) const {
  const auto alike = std::ranges::count_if(all, [&](const auto& r) { return r->name == run.name; });
  return alike > 1 ? fmt::format("{} ({})", run.name, run.directory.string()) : run.name;
}

Result<void> add_comparison(IllustratedPage& page, const Runs& runs) {
  page.add(page.body(), "h2", "Compared");
  add_table(page, runs);
  auto grid = page.add(page.body(), "div", {}, "figures");
  if (auto ok = show_table(page, grid, table, {}, runs); !ok) return ok;
  return add_transmissions(page, runs);
}

}  // namespace tribotwin::render
