#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/render/report/run/health.hpp>
#include <tribotwin/render/report/run/run_summary.hpp>
#include <tribotwin/twin/simulation/health.hpp>

namespace tribotwin::render {
namespace {

using twin::Finding;
using twin::Verdict;

constexpr std::string_view starting_points_check = "starting_points", law_range_check = "law_range";

Verdict verdict_of(const std::string& text) {
  for (const Verdict v : {Verdict::note, Verdict::expected, Verdict::warning})
    if (text == name(v)) return v;
  return Verdict::ok;
}

std::vector<Finding> findings_of(const RunData& run) {
  std::vector<Finding> all;
  for (const auto& f : entries(run, "health"))
    if (f.is_object())
      all.push_back({.check = text(f, "check"),
                     .joint = text(f, "joint"),
                     .value = number(f, {"value"}),
                     .unit = text(f, "unit"),
                     .threshold = number(f, {"threshold"}),
                     .verdict = verdict_of(text(f, "verdict")),
                     .cause = text(f, "cause"),
                     .effect = text(f, "effect"),
                     .remedy = text(f, "remedy")});
  return all;
}

std::string amount(double value, const std::string& unit) {
  return shown(value, "{:.3g}") + (unit == "1" || unit.empty() ? "" : " " + unit);
}

/// Whether `a` is worse than `b`, of the same check; ranges of joints differ.
bool worse(const Finding& a, const Finding& b) {
  if (a.verdict != b.verdict) return a.verdict > b.verdict;
  return a.value * b.threshold > b.value * a.threshold || (a.threshold == b.threshold && a.value > b.value);
}

/// The worst finding of each check.
std::vector<const Finding*> worst_of(const std::vector<Finding>& findings) {
  std::vector<const Finding*> worst;
  for (const Finding& f : findings) {
    const auto same = std::ranges::find_if(worst, [&](const Finding* w) { return w->check == f.check; });
    if (same == worst.end())
      worst.push_back(&f);
    else if (worse(f, **same))
      *same = &f;
  }
  return worst;
}

}  // namespace

std::size_t starting_points(const RunData& run) {
  return static_cast<std::size_t>(std::ranges::count_if(
      findings_of(run), [](const Finding& f) { return f.check == starting_points_check && f.verdict != Verdict::ok; }));
}

std::vector<Warning> warnings(const RunData& run) {
  const auto findings = findings_of(run);
  std::vector<Warning> all;
  for (const Finding* f : worst_of(findings))
    if (f->verdict == Verdict::warning) all.push_back({f->check, f->joint, f->remedy});
  return all;
}

std::string joints_outside_law(const RunData& run) {
  std::string all;
  for (const Finding& f : findings_of(run)) {
    const auto joint = std::ranges::find(run.joints, f.joint, &JointHistory::name);
    if (f.check == law_range_check && f.verdict != Verdict::ok && joint != run.joints.end() && joint->moved)
      all += (all.empty() ? "" : ", ") + f.joint;
  }
  return all;
}

bool has_checks(const RunData& run) { return !findings_of(run).empty(); }

std::string as_asked_text(const RunData& run) {
  const auto findings = findings_of(run);
  if (findings.empty())
    return run.summary.is_null() ? "nothing is known of the run's health without a summary."
                                 : "nothing is known of the run's health: its summary has no checks, as of an early "
                                   "version.";
  const auto checks = worst_of(findings);
  const auto warn = std::ranges::count(checks, Verdict::warning, &Finding::verdict);
  return warn ? fmt::format("The run is not what its scenario asked for: {} of {} checks warn{}.", warn, checks.size(),
                            warn == 1 ? "s" : "")
              : fmt::format("The run is what its scenario asked for: none of {} checks warns.", checks.size());
}

void add_warnings(pugi::xml_node to, const RunData& run) {
  pugi::xml_node box;
  for (const auto& line : twin::health_lines(findings_of(run))) {
    if (line.verdict != Verdict::warning && line.check != starting_points_check) continue;
    if (!box) box = Page::add(to, "div", {}, "notice");
    Page::add_named(box, line.check, " " + line.text);
  }
}

std::vector<std::string> health_notes(const RunData& run) {
  std::vector<std::string> notes;
  for (const auto& line : twin::health_lines(findings_of(run)))
    if (line.verdict == Verdict::note && line.check != starting_points_check) notes.push_back(line.text);
  return notes;
}

void add_health_table(pugi::xml_node to, const RunData& run) {
  const auto findings = findings_of(run);
  if (findings.empty()) return;
  Page::add(to, "h3", "Health check");
  std::vector<std::vector<std::string>> rows;
  for (const Finding* f : worst_of(findings)) {
    const auto check = std::ranges::find(twin::health_checks(), f->check, &twin::HealthCheck::name);
    rows.push_back({f->check, f->joint, amount(f->value, f->unit), amount(f->threshold, f->unit),
                    std::string(name(f->verdict)),
                    check == twin::health_checks().end() ? "" : std::string(check->measured)});
  }
  Page::add_table(to, {"check", "joint", "value", "ok up to", "verdict", "measured"}, rows);
  Page::add(to, "p", "Each check with its worst joint; summary.json has them all.", "soft");
}

std::vector<std::string> other_warnings(const RunData& run) {
  const auto lines = twin::health_lines(findings_of(run));
  std::vector<std::string> others;
  for (const auto& w : entries(run, "warnings"))
    if (w.is_string())
      if (const auto said = w.get<std::string>();
          std::ranges::find(lines, said, &twin::HealthLine::text) == lines.end())
        others.push_back(said);
  return others;
}

}  // namespace tribotwin::render
