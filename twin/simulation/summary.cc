#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/simulation/summary.hpp>

namespace tribotwin::twin {
namespace {

void check_balance(Summary& s) {
  const double residual = std::abs(s.energy_balance_J);
  s.balanced = residual <= std::max(balance_floor_J, balance_share * std::abs(s.friction_work_J));
  if (!s.balanced)
    s.warnings.push_back(fmt::format(
        "the mechanical energy balance is off by {:.3g} J, {:.3g} % of the friction work ({:.3g} J); at most {:g} % "
        "and {:g} J are expected. Is the timestep too long, "
        "or does something act on the joints that is neither a drive nor the friction law (damping, limits, contacts)?",
        residual, 100 * residual / std::max(std::abs(s.friction_work_J), 1e-300), s.friction_work_J,
        100 * balance_share, balance_floor_J));
}

}  // namespace

Summary summarize(const Twin& twin, double wall_s) {
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
                        .friction_nm = {std::sqrt(f.friction_squared_sum / static_cast<double>(std::max<std::int64_t>(
                                                                               1, twin.steps_computed()))),
                                        f.friction_max_nm},
                        .load_max_norm = f.load_max_norm,
                        .clamped_samples = static_cast<std::int64_t>(d.steps_outside),
                        .stuck_s = d.stuck_s});
    if (d.steps_outside > 0)
      s.warnings.push_back(fmt::format(
          "{}: {:.3g} % of the computed steps lay outside the range in which law '{}' was identified (policy: {})",
          s.joints.back().name, 100 * d.steps_outside / static_cast<double>(twin.steps_computed()),
          drives[i].drive.law.info->name,
          drives[i].drive.law.validity == friction::Validity::extrapolate ? "extrapolate" : "clamp"));
  }
  check_balance(s);
  return s;
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
    json["runs"].push_back({{"folder", run.folder}, {"set", run.settings}});
    for (const auto& warning : run.summary.warnings) json["warnings"].push_back(run.folder + ": " + warning);
    add_transmissions(json, run.summary);
  }
  return json.dump(2) + "\n";
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
  for (const auto& j : s.joints)
    json["joints"].push_back(
        {{"name", j.name},
         {"temperature_degC",
          {{"start", j.temperature_degC.start}, {"end", j.temperature_degC.end}, {"max", j.temperature_degC.max}}},
         {"friction_nm", {{"rms", j.friction_nm.rms}, {"max", j.friction_nm.max}}},
         {"load_norm", {{"max", j.load_max_norm}}},
         {"clamped_samples", j.clamped_samples},
         {"stuck_s", j.stuck_s}});
  json["warnings"] = s.warnings;
  add_transmissions(json, s);
  if (s.comparison)
    json["comparison"] = {{"mae_mrad", s.comparison->mae_mrad}, {"baseline_mae_mrad", s.comparison->baseline_mae_mrad}};
  return json.dump(2) + "\n";
}

}  // namespace tribotwin::twin
