#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/simulation/summary.hpp>

namespace tribotwin::twin {
namespace {

nlohmann::ordered_json health_json(const Summary& s) {
  auto all = nlohmann::ordered_json::array();
  for (const Finding& f : s.health) {
    nlohmann::ordered_json one{{"check", f.check}, {"joint", f.joint},         {"value", f.value},
                               {"unit", f.unit},   {"threshold", f.threshold}, {"verdict", name(f.verdict)}};
    if (f.verdict != Verdict::ok) {
      one["cause"] = f.cause;
      one["effect"] = f.effect;
      one["remedy"] = f.remedy;
    }
    all.push_back(std::move(one));
  }
  return all;
}

std::optional<JointSummary::Winding> winding_summary(const Twin& twin, std::size_t i) {
  if (!twin.model().drives()[i].drive.winding.present()) return std::nullopt;
  return JointSummary::Winding{twin.scenario().temperature_degC[i], twin.winding_degC(i),
                               std::max(twin.figures(i).winding_max_degC, twin.winding_degC(i)),
                               twin.drive(i).copper_loss_J, twin.drive(i).winding_heat_J};
}

}  // namespace

Summary summarize(const Twin& twin, double wall_s, double record_bytes) {
  Summary s{.simulated_s = twin.time_s(),
            .wall_s = wall_s,
            .steps = twin.steps(),
            .steps_computed = twin.steps_computed(),
            .seed = twin.scenario().seed,
            .motor_work_J = twin.motor_work_J(),
            .energy_balance_J = twin.balance_J()};
  const auto drives = twin.model().drives();
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const auto& d = twin.drive(i);
    const auto& f = twin.figures(i);
    s.friction_work_J += d.friction_work_J;
    s.heat_J += d.heat_J;
    s.joints.push_back({.name = joint_name(twin.model().get(), drives[i]),
                        .temperature_degC = {twin.scenario().temperature_degC[i], twin.temperature_degC(i),
                                             std::max(f.temperature_max_degC, twin.temperature_degC(i))},
                        .winding = winding_summary(twin, i),
                        .friction_nm = {std::sqrt(f.friction_squared_sum /
                                                  static_cast<double>(std::max<std::int64_t>(1, twin.steps()))),
                                        f.friction_max_nm},
                        .load_max_norm = f.load_max_norm,
                        .clamped_samples = std::llround(d.steps_outside),
                        .outside_s = d.steps_outside * twin.model().get()->opt.timestep,
                        .stuck_s = d.stuck_s,
                        .slide = is_slide(twin.model().get(), drives[i])});
  }
  s.health = examine({twin.scenario(), &twin, record_bytes});
  return s;
}

std::vector<std::string> all_warnings(const Summary& s) {
  std::vector<std::string> all;
  for (const HealthLine& line : health_lines(s.health)) all.push_back(line.text);
  all.insert(all.end(), s.warnings.begin(), s.warnings.end());
  return all;
}

namespace {

void add_transmissions(nlohmann::ordered_json& json, const Summary& s) {
  for (const auto& t : s.tracking)
    json["tracking"].push_back({{"temperature_degC", t.temperature_degC},
                                {"compensation", t.compensation},
                                {"l1_mrad", t.l1_mrad},
                                {"standstill_pp_mrad", t.standstill_pp_mrad}});
  for (const auto& l : s.loops)
    json["loops"].push_back({{"frequency_hz", l.frequency_hz},
                             {"temperature_degC", l.temperature_degC},
                             {"area_J", l.area_J},
                             {"torque_nm", l.torque_nm},
                             {"stiffness_nm_rad", l.stiffness_nm_rad}});
}

}  // namespace

std::string varied_json(std::span<const VariedRun> runs) {
  nlohmann::ordered_json json{{"runs", nlohmann::ordered_json::array()}, {"warnings", nlohmann::ordered_json::array()}};
  for (const VariedRun& run : runs) {
    json["runs"].push_back({{"folder", run.folder}, {"set", run.settings}, {"health", health_json(run.summary)}});
    for (const auto& warning : all_warnings(run.summary)) json["warnings"].push_back(run.folder + ": " + warning);
    add_transmissions(json, run.summary);
  }
  return dump_json(json, 2) + "\n";
}

std::string summary_json(const Summary& s) {
  nlohmann::ordered_json json{{"interrupted", s.interrupted},
                              {"simulated_s", s.simulated_s},
                              {"wall_s", s.wall_s},
                              {"steps", s.steps},
                              {"steps_computed", s.steps_computed},
                              {"realtime_factor", s.wall_s > 0 ? s.simulated_s / s.wall_s : 0},
                              {"seed", s.seed},
                              {"engine", {{"name", "MuJoCo"}, {"version", mj_versionString()}}},
                              {"friction_work_J", s.friction_work_J},
                              {"heat_J", s.heat_J},
                              {"motor_work_J", s.motor_work_J},
                              {"energy_balance_J", s.energy_balance_J}};
  json["joints"] = nlohmann::ordered_json::array();
  for (const auto& j : s.joints) {
    json["joints"].push_back(
        {{"name", j.name},
         {"friction_unit", unit_of("Nm", j.slide)},
         {"temperature_degC",
          {{"start", j.temperature_degC.start}, {"end", j.temperature_degC.end}, {"max", j.temperature_degC.max}}},
         {"friction_nm", {{"rms", j.friction_nm.rms}, {"max", j.friction_nm.max}}},
         {"load_norm", {{"max", j.load_max_norm}}},
         {"clamped_samples", j.clamped_samples},
         {"outside_s", j.outside_s},
         {"stuck_s", j.stuck_s}});
    if (const auto& w = j.winding)
      json["joints"].back()["winding"] = {
          {"temperature_degC", {{"start", w->start_degC}, {"end", w->end_degC}, {"max", w->max_degC}}},
          {"copper_loss_J", w->copper_loss_J},
          {"to_gear_J", w->to_gear_J}};
  }
  json["health"] = health_json(s);
  json["warnings"] = all_warnings(s);
  add_transmissions(json, s);
  if (!s.finished_at.empty()) json["finished_at"] = s.finished_at;
  if (s.comparison)
    json["comparison"] = {{"mae_mrad", s.comparison->mae_mrad}, {"baseline_mae_mrad", s.comparison->baseline_mae_mrad}};
  return dump_json(json, 2) + "\n";
}

}  // namespace tribotwin::twin
