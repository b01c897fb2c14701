#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include <fmt/format.h>

#include <tribotwin/render/report/run/run_summary.hpp>
#include <tribotwin/render/theme/theme.hpp>

namespace tribotwin::render {
namespace {

using nlohmann::json;

constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

JointSummary from_samples(const RunData& run, const JointHistory& j) {
  JointSummary f{j.name, unknown, unknown, unknown, unknown, unknown, unknown, unknown, unknown};
  double squares = 0;
  std::size_t n = 0;
  for (std::size_t i = 0; i < run.record.time_s.size(); ++i) {
    const auto at = [&](std::span<const double> v) { return i < v.size() ? v[i] : unknown; };
    if (const double t = at(j.temperature_degC); std::isfinite(t)) {
      if (!std::isfinite(f.start_degC)) f.start_degC = t;
      f.end_degC = t;
      f.max_degC = std::fmax(f.max_degC, t);
    }
    if (const double nm = at(j.friction_nm); std::isfinite(nm))
      squares += nm * nm, ++n, f.friction_max_nm = std::fmax(f.friction_max_nm, std::abs(nm));
    if (const double nm = at(j.load_nm); std::isfinite(nm))
      f.load_max = std::fmax(f.load_max, std::abs(nm) / j.torque_max_nm);
  }
  if (n) f.friction_rms_nm = std::sqrt(squares / static_cast<double>(n));
  return f;
}

}  // namespace

double number(const json& j, std::initializer_list<const char*> path) {
  const json* at = &j;
  for (const char* key : path) {
    if (!at->is_object() || !at->contains(key)) return unknown;
    at = &(*at)[key];
  }
  return at->is_number() ? at->get<double>() : unknown;
}

std::string text(const json& j, const char* key) {
  return j.is_object() && j.contains(key) && j[key].is_string() ? j[key].get<std::string>() : "";
}

const json& entries(const RunData& run, const char* key) {
  static const json none = json::array();
  return run.summary.is_object() && run.summary.contains(key) && run.summary[key].is_array() ? run.summary[key] : none;
}

std::string shown(double v, const char* format) {
  return std::isfinite(v) ? fmt::format(fmt::runtime(format), v) : "–";
}

std::string shown(double v, int count) { return std::isfinite(v) ? digits(v, count) : "–"; }

std::string load_text(double share) {
  constexpr double usual_max = 10;
  return share < usual_max ? shown(share, "{:.3f}") : shown(share, 4);
}

std::pair<const char*, double> energy_unit(double joule) {
  for (const auto& [unit, size] : {std::pair{"MJ", 1e6}, {"kJ", 1e3}})
    if (std::abs(joule) >= size) return {unit, size};
  return {"J", 1};
}

namespace {

/// Older summaries counted in the steps that were computed alone, of which multi-rate runs have few.
bool counts_all_time(const json& joint) { return joint.contains("outside_s"); }

double outside_share(const RunData& run, const json& joint) {
  return counts_all_time(joint) ? number(joint, {"outside_s"}) / number(run.summary, {"simulated_s"})
                                : number(joint, {"clamped_samples"}) / number(run.summary, {"steps_computed"});
}

double stuck_share(const RunData& run, const json& joint) {
  const double of_all = number(joint, {"stuck_s"}) / number(run.summary, {"simulated_s"});
  return counts_all_time(joint) ? of_all
                                : of_all * number(run.summary, {"steps"}) / number(run.summary, {"steps_computed"});
}

}  // namespace

std::vector<JointSummary> joint_summaries(const RunData& run) {
  std::vector<JointSummary> all;
  for (const auto& j : entries(run, "joints"))
    all.push_back({text(j, "name"), number(j, {"temperature_degC", "start"}), number(j, {"temperature_degC", "end"}),
                   number(j, {"temperature_degC", "max"}), number(j, {"friction_nm", "rms"}),
                   number(j, {"friction_nm", "max"}), number(j, {"load_norm", "max"}), outside_share(run, j),
                   stuck_share(run, j)});
  if (all.empty())
    for (const auto& j : run.joints) all.push_back(from_samples(run, j));
  return all;
}

const JointSummary* warmest(const std::vector<JointSummary>& joints) {
  const JointSummary* best = nullptr;
  for (const auto& j : joints)
    if (std::isfinite(j.max_degC) && (!best || j.max_degC > best->max_degC)) best = &j;
  return best;
}

const JointSummary* most_warmed(const RunData& run, const std::vector<JointSummary>& joints) {
  const JointSummary* best = nullptr;
  double rise_max_K = 1;  // less is no warm-up
  for (const auto& j : joints) {
    const auto history = std::ranges::find(run.joints, j.name, &JointHistory::name);
    const bool moved = history == run.joints.end() || history->moved;
    const double rise_K = j.end_degC - j.start_degC;
    if (moved && std::isfinite(rise_K) && rise_K > rise_max_K) rise_max_K = rise_K, best = &j;
  }
  return best;
}

double simulated_s(const RunData& run) {
  const double s = number(run.summary, {"simulated_s"});
  return std::isfinite(s) || run.record.time_s.empty() ? s : run.record.time_s.back();
}

}  // namespace tribotwin::render
