#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <set>

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <tribotwin/render/page/page.hpp>
#include <tribotwin/render/report/run/differences.hpp>
#include <tribotwin/render/report/run/run_summary.hpp>
#include <tribotwin/render/theme/theme.hpp>
#include <tribotwin/twin/io/input.hpp>

namespace tribotwin::render {
namespace {

using Keys = std::map<std::string, std::string>;

/// Names and texts for people: what they say shows in other keys.
bool for_people(const std::string& key) { return key == "name" || key == "description"; }

void flatten(const YAML::Node& node, const std::string& at, Keys& keys);

/// "wear of joint2 at 0 s: Fc0 1.2, Fcl 1.2".
std::string event_text(const YAML::Node& event) {
  Keys parts;
  flatten(event, "", parts);
  const auto take = [&parts](const char* key) {
    const auto part = parts.extract(key);
    return part.empty() ? std::string() : part.mapped();
  };
  std::string text = take("type");
  if (const auto joint = take("joint"); !joint.empty()) text += " of " + joint;
  if (const auto time = take("time_s"); !time.empty()) text += fmt::format(" at {} s", time);
  std::string_view before = ": ";
  for (const auto& [key, value] : parts) {
    text += fmt::format("{}{} {}", before, key.substr(key.rfind('.') + 1), value);
    before = ", ";
  }
  return text;
}

void flatten(const YAML::Node& node, const std::string& at, Keys& keys) {
  if (at == "events" && node.IsSequence())
    for (std::size_t i = 0; i < node.size(); ++i) keys[fmt::format("events[{}]", i + 1)] = event_text(node[i]);
  else if (node.IsMap())
    for (const auto& entry : node)
      flatten(entry.second, (at.empty() ? "" : at + ".") + entry.first.as<std::string>(""), keys);
  else if (node.IsSequence() && std::ranges::any_of(node, [](const YAML::Node& n) { return !n.IsScalar(); }))
    for (std::size_t i = 0; i < node.size(); ++i) flatten(node[i], fmt::format("{}[{}]", at, i + 1), keys);
  else if (node.IsSequence()) {
    std::string list;
    for (const auto& entry : node) list += (list.empty() ? "" : ", ") + entry.Scalar();
    keys[at] = "[" + list + "]";
  } else if (node.IsScalar())
    keys[at] = without_folders(node.Scalar());
}

Keys keys_of(const RunData& run) {
  Keys keys;
  try {
    flatten(twin::parse_yaml(run.scenario_text, "scenario.yaml"), "", keys);
  } catch (const std::exception&) {
    keys.clear();  // the page says elsewhere that the scenario cannot be read
  }
  for (const char* of_record : {"engine_version", "timestep_s"})
    if (const auto value = run.attribute(of_record); !value.empty()) keys["record: " + std::string(of_record)] = value;
  return keys;
}

}  // namespace

const JointHistory* history_of(const RunData& run, const std::string& joint) {
  const auto j = std::ranges::find(run.joints, joint, &JointHistory::name);
  return j == run.joints.end() ? nullptr : &*j;
}

double friction_power_w(const JointHistory* joint) {
  return joint ? joint->friction_power_w : std::numeric_limits<double>::quiet_NaN();
}

std::vector<DifferingKey> differing_keys(std::span<const std::unique_ptr<RunData>> runs) {
  std::vector<Keys> all;
  std::set<std::string> names;
  for (const auto& run : runs)
    for (const auto& [key, value] : all.emplace_back(keys_of(*run)))
      if (!for_people(key)) names.insert(key);
  std::vector<DifferingKey> differing;
  for (const auto& name : names) {
    DifferingKey row{name, {}};
    for (const Keys& keys : all) {
      const auto at = keys.find(name);
      row.values.push_back(at == keys.end() ? "–" : at->second);
    }
    if (std::ranges::any_of(row.values, [&](const auto& v) { return v != row.values.front(); }))
      differing.push_back(std::move(row));
  }
  return differing;
}

std::vector<FrictionChange> friction_changes(std::span<const std::unique_ptr<RunData>> runs) {
  std::vector<FrictionChange> changes;
  const auto first = joint_summaries(*runs.front());
  for (std::size_t r = 1; r < runs.size(); ++r) {
    const auto others = joint_summaries(*runs[r]);
    for (const JointSummary& joint : first) {
      const auto other = std::ranges::find(others, joint.name, &JointSummary::name);
      const JointHistory *before = history_of(*runs.front(), joint.name), *after = history_of(*runs[r], joint.name);
      if (other == others.end() || (before && !before->moved) || (after && !after->moved)) continue;
      if (!(joint.friction_rms_nm > 0) || !std::isfinite(other->friction_rms_nm)) continue;
      const bool slide = after && after->slide;
      changes.push_back({joint.name, r, joint.friction_rms_nm, other->friction_rms_nm, slide ? "N" : "Nm",
                         friction_power_w(after) - friction_power_w(before)});
    }
  }
  return changes;
}

bool know_power(const std::vector<FrictionChange>& changes) {
  return std::ranges::all_of(changes, [](const auto& c) { return std::isfinite(c.power_change_w); });
}

namespace {

/// Those whose share is above `share`, the largest change of power first.
std::vector<const FrictionChange*> ranked(double share, const std::vector<FrictionChange>& changes) {
  std::vector<const FrictionChange*> all;
  for (const FrictionChange& c : changes)
    if (std::abs(c.share()) > share) all.push_back(&c);
  std::ranges::stable_sort(all, std::greater{}, [power = know_power(changes)](const FrictionChange* c) {
    return std::abs(power ? c->power_change_w : c->other - c->first);
  });
  return all;
}

}  // namespace

const FrictionChange* largest(const std::vector<FrictionChange>& changes) {
  auto all = ranked(resolved_share, changes);
  if (all.empty()) all = ranked(-1, changes);
  return all.empty() ? nullptr : all.front();
}

std::vector<const FrictionChange*> others_beyond(double share, const std::vector<FrictionChange>& changes,
                                                 const FrictionChange& most) {
  std::vector<const FrictionChange*> others;
  for (const FrictionChange* c : ranked(share, changes))
    if (c->joint != most.joint && std::ranges::find(others, c->joint, &FrictionChange::joint) == others.end())
      others.push_back(c);
  return others;
}

std::string change_text(double from, double to, const std::string& unit, double scatter) {
  const double change = to - from, size = std::max(std::abs(from), std::abs(to));
  if (!(std::abs(change) > 1e-6 * size)) return "none";
  // No ratio of temperatures has a meaning, nor one of works of which the motors take up one.
  const bool no_ratio = unit == "°C" || from <= 0 || to < 0;
  const std::string suffix = unit.empty() ? "" : unit == "°C" ? " K" : " " + unit;
  const std::string number = (change > 0 ? "+" : "") + digits(change, 3) +
                             (std::isfinite(scatter) ? " ± " + digits(scatter > 1e-6 * size ? scatter : 0, 2) : "");
  return fmt::format("{}{}{}", number, suffix, no_ratio ? "" : fmt::format(", {:+.1f} %", 100 * (to / from - 1)));
}

}  // namespace tribotwin::render
