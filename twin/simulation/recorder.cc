#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>
#include <tribotwin/twin/simulation/recorder.hpp>
#include <tribotwin/twin/simulation/run_folder.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using Status = Result<void>;

const std::vector<Channel> channels = {
    {"position_rad", "rad", "joint angle, arm side, at time_s"},
    {"velocity_rad_s", "rad/s", "joint speed, arm side, at time_s"},
    {"motor_torque_nm", "Nm", "motor torque, motor side, over the step from time_s (arm side: torque_nm)"},
    {"torque_nm", "Nm", "motor torque seen from the arm: motor_torque_nm x gear ratio"},
    {"friction_nm", "Nm",
     "transmitted friction, arm side, positive when it opposes positive motion, over the step from time_s"},
    {"load_nm", "Nm", "gear torque that friction was evaluated at, arm side, signed"},
    {"temperature_degC", "degC", "lubricant temperature that friction was evaluated at"},
};
/// Of a drive behind a transmission; NaN for other drives of its model.
const std::vector<Channel> transmission_channels = {
    {"torsion_rad", "rad", "torsion of the transmission, arm side, at time_s"},
    {"transmission_torque_nm", "Nm", "torque of the transmission on the arm, at time_s"},
    {"arm_position_rad", "rad", "angle behind the transmission, at time_s"},
    {"arm_set_point_rad", "rad", "set point of arm_position_rad, before any compensation, at time_s"},
};
const std::vector<Channel> cycle_channels = {
    {"cycle_temperature_degC", "degC", "lubricant temperature at the end of a work cycle"},
    {"cycle_friction_power_W", "W", "mean friction power over a work cycle"},
};

std::vector<Channel> channels_of(const mujoco::Model& model) {
  std::vector<Channel> all = channels;
  if (!model.springs().empty()) all.insert(all.end(), transmission_channels.begin(), transmission_channels.end());
  return all;
}

}  // namespace

struct Recorder::Impl {
  RunFolder folder;
  fs::path directory;
  std::unique_ptr<Telemetry> telemetry;
  std::int64_t every = 1;
  double timestep_s = 0;
  std::vector<double> row;
};

Recorder::Recorder(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Recorder::~Recorder() = default;

Result<std::unique_ptr<Recorder>> Recorder::create(const fs::path& directory, const Scenario& scenario, bool cycles,
                                                   Existing existing) {
  auto impl = std::make_unique<Impl>();
  impl->timestep_s = scenario.model->get()->opt.timestep;
  impl->every = std::max<std::int64_t>(1, std::llround(1 / (scenario.telemetry_rate_hz * impl->timestep_s)));
  if (auto ok = impl->folder.open(directory, existing); !ok) return tl::unexpected(ok.error());
  impl->directory = directory;
  TelemetryOptions o{.attributes = {{"engine", "MuJoCo"},
                                    {"engine_version", mj_versionString()},
                                    {"scenario", scenario.name},
                                    {"seed", std::to_string(scenario.seed)},
                                    {"timestep_s", fmt::format("{}", impl->timestep_s)}},
                     .channels = channels_of(*scenario.model),
                     .cycle_channels = cycles ? cycle_channels : std::vector<Channel>{}};
  for (const auto& drive : scenario.model->drives()) {
    o.joints.push_back(joint_name(scenario.model->get(), drive));
    o.joint_attributes.push_back(
        {{"gear_ratio", drive.drive.gear_ratio}, {"torque_max_nm", drive.drive.torque_max_nm}});
  }
  impl->row.resize(o.joints.size() * o.channels.size());
  auto telemetry = Telemetry::create(directory / "telemetry.h5", std::move(o));
  if (!telemetry) return tl::unexpected(telemetry.error());
  impl->telemetry = std::make_unique<Telemetry>(std::move(*telemetry));
  if (auto ok = write_file(directory / "scenario.yaml", scenario.resolved_yaml, Existing::refuse); !ok) {
    std::error_code ignored;
    fs::remove(directory / "telemetry.h5", ignored);  // nothing was recorded
    return tl::unexpected(ok.error());
  }
  impl->folder.keep_both();
  return std::unique_ptr<Recorder>(new Recorder(std::move(impl)));
}

Status Recorder::sample(const Twin& twin, std::int64_t step) {
  if (step % impl_->every != 0) return {};
  const std::size_t drives = twin.model().drives().size(), columns = impl_->row.size() / drives;
  std::ranges::fill(impl_->row, std::nan(""));
  for (std::size_t i = 0; i < drives; ++i) {
    const auto& d = twin.drive(i);
    const double gear = twin.model().drives()[i].drive.gear_ratio;
    const double values[] = {twin.position_rad(i), twin.velocity_rad_s(i), d.torque_nm / gear, d.torque_nm,
                             d.friction_nm,        d.load_used_nm,         d.temperature_degC};
    std::ranges::copy(values, impl_->row.begin() + static_cast<std::ptrdiff_t>(i * columns));
  }
  for (const auto& spring : twin.model().springs()) {
    const auto t = twin.transmission(spring);
    const double values[] = {t.torsion_rad, t.torque_nm, t.arm_rad, t.arm_set_point_rad};
    std::ranges::copy(values, impl_->row.begin() + static_cast<std::ptrdiff_t>(t.drive * columns + channels.size()));
  }
  return impl_->telemetry->append(static_cast<double>(step) * impl_->timestep_s, impl_->row);
}

Status Recorder::append_cycle(double time_s, std::span<const double> values) {
  return impl_->telemetry->append_cycle(time_s, values);
}

Status Recorder::finish(const Summary& summary) {
  if (auto ok = impl_->telemetry->finish(!summary.interrupted); !ok) return ok;
  if (auto ok = write_file(impl_->directory / "summary.json", summary_json(summary), Existing::refuse); !ok) return ok;
  if (!summary.interrupted) impl_->folder.commit();
  return {};
}

const fs::path& Recorder::replaced() const { return impl_->folder.aside(); }

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

Summary summarize(const Twin& twin, const Scenario& scenario, double wall_s) {
  Summary s{.simulated_s = twin.time_s(),
            .wall_s = wall_s,
            .steps = twin.steps(),
            .steps_computed = twin.steps_computed(),
            .seed = scenario.seed,
            .motor_work_J = twin.motor_work_J(),
            .energy_balance_J = twin.balance_J()};
  const auto drives = twin.model().drives();
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const auto& d = twin.drive(i);
    const auto& f = twin.figures(i);
    s.friction_work_J += d.friction_work_J;
    s.heat_J += d.heat_J;
    s.joints.push_back({.name = joint_name(twin.model().get(), drives[i]),
                        .temperature_degC = {scenario.temperature_degC[i], twin.temperature_degC(i),
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
