#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <limits>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/render/report/record/cycles.hpp>
#include <tribotwin/render/report/record/traces.hpp>
#include <tribotwin/render/report/run/comparison.hpp>
#include <tribotwin/render/report/run/differences.hpp>
#include <tribotwin/render/report/run/histories.hpp>
#include <tribotwin/render/report/run/run_summary.hpp>
#include <tribotwin/render/report/run/transmissions.hpp>
#include <tribotwin/twin/numerics/interpolation.hpp>

namespace tribotwin::render {
namespace {

constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

/// A column of every run: in several tables where those of one would not fit on paper.
void add_table(IllustratedPage& page, const std::vector<std::string>& head,
               const std::vector<std::vector<std::string>>& rows) {
  for (std::size_t from = 1; from < head.size(); from += overlaid_max) {
    const bool last = head.size() - from <= overlaid_max + 1;  // that of differences needs no table of its own
    const std::size_t to = last ? head.size() : from + overlaid_max;
    const auto part = [&](const std::vector<std::string>& row) {
      std::vector<std::string> cells{row.front()};
      cells.insert(cells.end(), row.begin() + static_cast<std::ptrdiff_t>(from),
                   row.begin() + static_cast<std::ptrdiff_t>(to));
      return cells;
    };
    std::vector<std::vector<std::string>> parts;
    std::ranges::transform(rows, std::back_inserter(parts), part);
    page.add_table(page.body(), part(head), parts);
    if (last) return;
  }
}

/// What came of every run, and how it differs from what came of the first: of two runs in a last column, of as many as
/// are overlaid in rows of their own.
class Results {
 public:
  explicit Results(const Runs& runs) : runs_(runs) {}

  /// The value of every run, as a format or with so many digits. `scatters`: what a difference of single cycles of each
  /// run and of the first scatters by, NaN where that is not known; or none.
  void add(const std::string& what, const std::string& unit, auto format, auto value,
           const std::vector<double>& scatters = {}) {
    std::vector<double> values;
    for (const auto& run : runs_.all) values.push_back(value(*run));
    if (std::ranges::none_of(values, [](double v) { return std::isfinite(v); })) return;
    std::vector<std::string> row{unit.empty() ? what : fmt::format("{} [{}]", what, unit)}, changes{what};
    for (const double v : values) row.push_back(shown(v, format));
    for (std::size_t i = 1; i < values.size(); ++i) {
      const double scatter = i < scatters.size() ? scatters[i] : unknown;
      scatters_ = scatters_ || std::isfinite(scatter);
      const bool both = std::isfinite(values[0] + values[i]);
      changes.push_back(both ? change_text(values[0], values[i], unit, scatter) : "–");
    }
    if (values.size() == 2) row.push_back(changes.back());
    rows_.push_back(std::move(row));
    if (std::any_of(changes.begin() + 1, changes.end(), [](const auto& c) { return c != "none"; }))
      differences_.push_back(std::move(changes));
  }

  void show(IllustratedPage& page) {
    const std::size_t count = runs_.all.size();
    std::vector<std::string> head{"result"};
    for (const auto& run : runs_.all) head.push_back(runs_.label(*run));
    const std::string first = head[1];
    if (count == 2) head.emplace_back("difference");
    add_table(page, head, rows_);
    if (count > 2 && !runs_.many() && !differences_.empty()) {
      head.erase(head.begin());
      head.front() = "difference from " + first;
      add_table(page, head, differences_);
    }
    page.add(page.body(), "p", meaning(), "soft");
  }

 private:
  /// What the differences are worth.
  std::string meaning() const {
    const std::string all = fmt::format(
        "Simulations have no noise: what is above {:g} %, which multi-rate runs may leave, is a difference.",
        100 * resolved_share);
    if (runs_.many()) return all;  // no differences in the table
    return all + (scatters_
                      ? " ± is the standard deviation of the difference of two single work cycles, one of each run, "
                        "by how far cycles are from the mean of their neighbours; means over a run are surer."
                      : " No ±: too few neighbouring work cycles were computed to say how they scatter.");
  }

  const Runs& runs_;
  std::vector<std::vector<std::string>> rows_, differences_;
  bool scatters_ = false;
};

/// Of the difference of a joint's friction power in two work cycles, one of each run and one of the first [W]; NaN
/// where one of both does not say.
std::vector<double> scatters_of_cycles(const Runs& runs, const std::string& joint) {
  std::vector<double> scatters;
  for (const auto& run : runs.all) {
    const JointHistory* j = history_of(*run, joint);
    scatters.push_back(j ? friction_power_scatter(*run, *j) : unknown);
  }
  const double first = scatters.front();
  std::ranges::transform(scatters, scatters.begin(), [first](double own) { return std::hypot(first, own); });
  return scatters;
}

/// Power of work cycles where all runs have them, which no choice of samples can distort; else root mean squares.
bool compares_power(const Runs& runs) {
  return std::ranges::all_of(runs.all, [](const auto& run) { return has_cycles(*run); });
}

/// Values of one joint or, where it is empty, the maximum over all.
double of_joints(const RunData& run, const std::string& name, double JointSummary::*value) {
  double all = unknown;
  for (const JointSummary& j : joint_summaries(run))
    if (name.empty() || j.name == name) all = std::fmax(all, j.*value);
  return all;
}

/// In the unit of the largest.
void add_work(Results& results, const Runs& runs, const std::string& what, const char* key) {
  double most = 0;
  for (const auto& run : runs.all) most = std::fmax(most, std::abs(number(run->summary, {key})));
  const auto unit = energy_unit(most);
  results.add(what, unit.first, 5, [&](const RunData& r) { return number(r.summary, {key}) / unit.second; });
}

void add_results(IllustratedPage& page, const Runs& runs) {
  Results results(runs);
  results.add("simulated", "s", "{:.1f}", [](const RunData& r) { return simulated_s(r); });
  for (const auto& joint : runs.all.front()->joints) {
    if (!joint.moved) continue;
    results.add(joint.name + ": friction, RMS", joint.slide ? "N" : "Nm", 4,
                [&](const RunData& r) { return of_joints(r, joint.name, &JointSummary::friction_rms_nm); });
    if (compares_power(runs))
      results.add(
          joint.name + ": friction power", "W", 4,
          [&](const RunData& r) { return friction_power_w(history_of(r, joint.name)); },
          scatters_of_cycles(runs, joint.name));
    results.add(joint.name + ": maximum temperature", "°C", "{:.2f}",
                [&](const RunData& r) { return of_joints(r, joint.name, &JointSummary::max_degC); });
  }
  add_work(results, runs, "friction work", "friction_work_J");
  add_work(results, runs, "motor work", "motor_work_J");
  results.add("maximum load", "", "{:.3f}", [](const RunData& r) { return of_joints(r, "", &JointSummary::load_max); });
  results.add("error against recording", "mrad", "{:.1f}", [](const RunData& r) {
    return number(r.summary, {"comparison", "mae_mrad"});
  });
  results.show(page);
}

void add_differing_keys(IllustratedPage& page, const Runs& runs) {
  page.add(page.body(), "h3", "What was asked for");
  const auto keys = differing_keys(runs.all);
  if (keys.empty()) {
    page.add(page.body(), "p", "The scenarios are the same.");
    return;
  }
  std::vector<std::string> head{"key"};
  for (const auto& run : runs.all) head.push_back(runs.label(*run));
  std::vector<std::vector<std::string>> rows;
  for (const auto& key : keys) {
    rows.push_back({key.key});
    rows.back().insert(rows.back().end(), key.values.begin(), key.values.end());
  }
  add_table(page, head, rows);
}

/// The joint whose friction differs most, else the warmest of the first run.
std::string watched_joint(const Runs& runs) {
  const auto changes = friction_changes(runs.all);
  if (const auto* most = largest(changes); most && std::abs(most->share()) > resolved_share) return most->joint;
  const auto joints = joint_summaries(*runs.all.front());
  const auto* hot = warmest(joints);
  return hot ? hot->name : "";
}

/// Of its friction.
std::string unit_of_watched(const Runs& runs) {
  std::vector<JointHistory> all;
  for (const auto& run : runs.all) all.insert(all.end(), run->joints.begin(), run->joints.end());
  return force_unit(all, [name = watched_joint(runs)](const JointHistory& j) { return j.name == name; });
}

/// A curve of the watched joint in each run that `trace` has values for.
std::vector<Trace> of_runs(const Runs& runs, auto trace) {
  const std::string name = watched_joint(runs);
  std::vector<Trace> traces;
  for (std::size_t i = 0; i < runs.all.size(); ++i)
    for (const auto& j : runs.all[i]->joints)
      if (j.name == name && !runs.all[i]->record.time_s.empty())
        if (Trace t = trace(runs.label(*runs.all[i]), *runs.all[i], j); any_finite(t)) {
          t.stroke = i;
          traces.push_back(std::move(t));
        }
  return traces;
}

/// The others minus the first, at the times of the others.
std::vector<Trace> differences(const std::vector<Trace>& traces) {
  std::vector<Trace> all;
  const Trace& first = traces.front();
  for (std::size_t r = 1; r < traces.size(); ++r) {
    Trace d{traces[r].label + " − " + first.label, {}, {}, traces[r].stroke};
    for (std::size_t i = 0; i < traces[r].time_s.size(); ++i) {
      const double t = traces[r].time_s[i];
      if (t < first.time_s.front() || t > first.time_s.back()) continue;
      d.time_s.push_back(t);
      d.values.push_back(traces[r].values[i] - twin::between_samples(first.time_s, first.values, t));
    }
    if (any_finite(d)) all.push_back(std::move(d));
  }
  return all;
}

std::vector<Trace> temperatures(const Runs& runs) {
  return of_runs(runs, [](std::string label, const RunData& run, const JointHistory& j) {
    return lubricant_temperature(std::move(label), run, j);
  });
}

std::vector<Trace> frictions(const Runs& runs) {
  const bool power = compares_power(runs);
  return of_runs(runs, [power](std::string label, const RunData& run, const JointHistory& j) {
    return power ? friction_power(std::move(label), run, j) : friction_rms(std::move(label), run, j);
  });
}

Axis friction_axis(const Runs& runs) {
  if (compares_power(runs)) return {.quantity = "friction power", .symbol = "{/:Italic P}", .unit = "W"};
  return {.quantity = "friction, RMS", .symbol = "{/:Italic τ}_f", .unit = unit_of_watched(runs)};
}

std::string friction_caption(const Runs& runs) {
  return compares_power(runs) ? "mean friction power of each work cycle"
                              : "friction, " + friction_rms_caption(*runs.all.front());
}

std::optional<Drawing> drawn(const Axis& axis, const std::vector<Trace>& traces, std::string caption) {
  if (traces.empty()) return std::nullopt;
  return Drawing{history("", axis, traces), std::move(caption)};
}

std::optional<Drawing> temperature(const Runs& runs) {
  return drawn(lubricant_temperature(), temperatures(runs), fmt::format("{} in each run.", watched_joint(runs)));
}

std::optional<Drawing> temperature_difference(const Runs& runs) {
  const auto all = temperatures(runs);
  if (all.size() < 2) return std::nullopt;
  return drawn({.quantity = "difference of temperature", .unit = "K"}, differences(all),
               fmt::format("{}: each run minus the first.", watched_joint(runs)));
}

std::optional<Drawing> friction(const Runs& runs) {
  return drawn(friction_axis(runs), frictions(runs),
               fmt::format("{}: {}.", watched_joint(runs), friction_caption(runs)));
}

std::optional<Drawing> friction_difference(const Runs& runs) {
  const auto all = frictions(runs);
  if (all.size() < 2) return std::nullopt;
  Axis axis = friction_axis(runs);
  axis.quantity = "difference of " + axis.quantity;
  axis.symbol = "";
  return drawn(axis, differences(all), fmt::format("{}: each run minus the first.", watched_joint(runs)));
}

constexpr FigureRow<Runs> table[] = {
    {"compared_friction", "Friction", friction},
    {"friction_difference", "Difference of friction", friction_difference},
    {"compared_temperature", "Temperature", temperature},
    {"temperature_difference", "Difference of temperature", temperature_difference},
};

/// What differs in a run from the first, in a line: "ambient_degC 15; events[1] –".
std::string asked_for(std::span<const DifferingKey> keys, std::size_t run) {
  constexpr std::size_t most = 3;
  std::string text;
  std::size_t told = 0;
  for (const auto& key : keys)
    if (key.values[run] != key.values.front() && told++ < most)
      text += fmt::format("{}{} {}", text.empty() ? "" : "; ", key.key, key.values[run]);
  return told > most ? text + fmt::format("; {} more key{}", told - most, told - most > 1 ? "s" : "") : text;
}

/// The axes around all values, from 0.
void fix_axes(Figure& f) {
  double low = std::numeric_limits<double>::infinity(), high = -low, end = 0;
  for (const Series& s : f.series) {
    for (const double v : s.y)
      if (std::isfinite(v)) low = std::min(low, v), high = std::max(high, v);
    for (const double t : s.x) end = std::max(end, t);
  }
  const double margin = low < high ? 0.03 * (high - low) : std::max(0.1 * std::abs(low), 1e-3);
  f.x.from = 0, f.x.to = end, f.y.from = low - margin, f.y.to = high + margin;
}

/// A small figure of each run but the first, which each shows, too; all with the same axes.
Result<void> add_small(IllustratedPage& page, const Runs& runs, const std::string& name, const Axis& axis,
                       const std::vector<Trace>& traces, const std::string& what) {
  if (traces.size() < 2) return {};
  page.add(page.body(), "p", fmt::format("{}. Thin dashed: {}. All have the same axes.", what, traces.front().label));
  auto grid = page.add(page.body(), "div", {}, "figures many");
  const auto keys = differing_keys(runs.all);
  Figure one = history("", axis, traces);
  fix_axes(one);
  const std::vector<Series> all = std::exchange(one.series, {});
  Series first = all.front();
  first.label.clear(), first.mark = Mark::reference;
  for (std::size_t i = 1; i < traces.size(); ++i) {
    one.series = {first, all[i]};
    one.series[1].stroke = 0;
    if (auto ok = page.show(grid, one, name, asked_for(keys, *traces[i].stroke), Width::small); !ok) return ok;
  }
  return {};
}

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
  if (std::ranges::count(all, run.name, [](const auto& r) { return r->name; }) < 2) return run.name;
  const auto parts_of = [](const RunData& r) {
    std::error_code error;
    const auto path = (std::filesystem::absolute(r.directory, error) / "").lexically_normal().parent_path();
    return std::vector<std::string>(path.begin(), path.end());
  };
  const auto own = parts_of(run);
  std::size_t needed = 1;
  for (const auto& r : all) {
    const auto other = parts_of(*r);
    if (other == own) continue;
    const auto differs = std::mismatch(own.rbegin(), own.rend(), other.rbegin(), other.rend()).first;
    needed = std::max(needed, static_cast<std::size_t>(differs - own.rbegin()) + 1);
  }
  std::filesystem::path label;
  for (const auto& part : std::span(own).last(std::min(needed, own.size()))) label /= part;
  return label.string();
}

Result<void> add_comparison(IllustratedPage& page, const Runs& runs) {
  page.add(page.body(), "h2", "Compared");
  add_differing_keys(page, runs);
  page.add(page.body(), "h3", "What came of it");
  if (runs.many()) {
    const std::string joint = watched_joint(runs);
    if (auto ok = add_small(page, runs, "compared_friction", friction_axis(runs), frictions(runs),
                            fmt::format("{}: {}", joint, friction_caption(runs)));
        !ok)
      return ok;
    if (auto ok = add_small(page, runs, "compared_temperature", lubricant_temperature(), temperatures(runs),
                            fmt::format("{}: lubricant temperature", joint));
        !ok)
      return ok;
  } else {
    auto grid = page.add(page.body(), "div", {}, "figures");
    if (auto ok = show_table(page, grid, table, {}, runs); !ok) return ok;
  }
  add_results(page, runs);
  return add_transmissions(page, runs);
}

}  // namespace tribotwin::render
