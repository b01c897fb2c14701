#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/format.h>

#include <tribotwin/twin/commands/calibrate/results.hpp>
#include <tribotwin/twin/identification/dynamic_friction/parameters.hpp>

namespace tribotwin::twin::program {
namespace {

namespace fs = std::filesystem;
using namespace identification;
using Results = CalibrationResults;

/// Index of the quantity of a law parameter of a joint; the number of quantities where no quantity belongs to it.
std::ptrdiff_t quantity_of(const Variant& variant, const std::string& joint, std::string_view parameter) {
  return std::ranges::find_if(variant.quantities,
                              [&](const Quantity& q) {
                                return q.place == Place::drive && q.key == parameter &&
                                       (q.owner.empty() || q.owner == joint);
                              }) -
         variant.quantities.begin();
}

/// The law's parameters with their status and sigma in the fit.
void add_estimates(ParameterFile& file, const Variant& variant, const std::string& joint, const SimulationFit& f) {
  const auto& parameters = file.law.info->parameters;
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    const auto& p = parameters[i];
    Estimate e{.name = std::string(p.name),
               .unit = std::string(p.unit),
               .value = file.law.parameters[i],
               .sigma = std::nan(""),
               .low = std::nan(""),
               .high = std::nan(""),
               .status = identification::Status::fixed};
    if (const auto at = static_cast<std::size_t>(quantity_of(variant, joint, p.name)); at < variant.quantities.size()) {
      using enum identification::Status;
      const ParameterStatus k = f.status[at];
      e.status = k == ParameterStatus::estimated  ? estimated
                 : k == ParameterStatus::prior    ? held
                 : k == ParameterStatus::at_bound ? at_bound
                                                  : fixed;
      if (k == ParameterStatus::prior) file.found.unidentifiable.emplace_back(p.name);
      if (k == ParameterStatus::estimated)
        e.sigma = f.sigma[at], e.low = e.value - 1.96 * e.sigma, e.high = e.value + 1.96 * e.sigma;
    }
    file.found.parameters.push_back(std::move(e));
  }
  file.found.covariance = Eigen::MatrixXd::Constant(std::ssize(parameters), std::ssize(parameters), std::nan(""));
  for (std::size_t i = 0; i < parameters.size(); ++i)
    for (std::size_t k = 0; k < parameters.size(); ++k)
      if (const auto a = quantity_of(variant, joint, parameters[i].name),
          b = quantity_of(variant, joint, parameters[k].name);
          std::max(a, b) < std::ssize(variant.quantities))
        file.found.covariance(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) =
            f.correlation(a, b) * file.found.parameters[i].sigma * file.found.parameters[k].sigma;
}

ParameterFile parameter_file(const Results& r, const SimulationFit& f, const mujoco::Model& model, std::size_t i) {
  const Variant& variant = r.campaign.plan.variants[f.variant];
  const drive::Drive& drive = model.drives()[i].drive;
  ParameterFile file{.law = drive.law, .torque_max_nm = drive.torque_max_nm, .gear_ratio = drive.gear_ratio};
  add_estimates(file, variant, joint_name(model.get(), model.drives()[i]), f);
  for (const auto& recording : r.campaign.plan.recordings) {
    file.data.push_back(recording.file.string());
    file.found.samples += recording.points.time_s.size();
  }
  file.found.notes.push_back(
      fmt::format("found by simulation (tribotwin calibrate {}): mean absolute error of position {:.1f} mrad; of "
                  "friction itself nothing was measured, so its residual is not known",
                  r.campaign.file.string(), r.mae(f, false)));
  for (std::size_t q = 0; q < variant.quantities.size(); ++q)
    if (variant.quantities[q].place != Place::drive && variant.quantities[q].free)
      file.found.notes.push_back(fmt::format("{} = {:.6g}{} ({})", variant.quantities[q].path(), f.values[q],
                                             std::isfinite(f.sigma[q]) ? fmt::format(" +- {:.2g}", f.sigma[q]) : "",
                                             name(f.status[q])));
  return file;
}

/// The section `control` of a scenario that follows the recording.
void write_control(YAML::Emitter& out, const Variant& variant, const SimulationFit& f, const Recording& shown) {
  out << YAML::Key << "control" << YAML::Value << YAML::Flow << YAML::BeginMap;
  out << YAML::Key << "type" << YAML::Value << std::string(name(variant.controller));
  if (variant.controller == Controller::servo || variant.controller == Controller::velocity)
    out << YAML::Key << "gravity" << YAML::Value << false;
  const auto set_by_recording = [&](const std::string& key) {
    return std::ranges::find(shown.control, key, [](const auto& c) { return c.first; }) != shown.control.end();
  };
  std::map<std::string, std::vector<std::size_t>> keys;
  for (std::size_t q = 0; q < variant.quantities.size(); ++q)
    if (variant.quantities[q].place == Place::control && !set_by_recording(variant.quantities[q].key))
      keys[variant.quantities[q].key].push_back(q);
  for (const auto& [key, quantities] : keys) {
    out << YAML::Key << key << YAML::Value;
    if (variant.quantities[quantities[0]].owner.empty()) {
      out << f.values[quantities[0]];
      continue;
    }
    out << YAML::Flow << YAML::BeginMap;
    for (const std::size_t q : quantities)
      out << YAML::Key << variant.quantities[q].owner << YAML::Value << f.values[q];
    out << YAML::EndMap;
  }
  for (const auto& [key, value] : shown.points.numbers)
    if (key == "vin" && variant.controller == Controller::dc_position && !keys.contains("supply_V") &&
        !set_by_recording("supply_V"))
      out << YAML::Key << "supply_V" << YAML::Value << value;
  for (const auto& [key, value] : shown.control) out << YAML::Key << key << YAML::Value << value;
  out << YAML::EndMap;
}

/// The motion of a scenario that follows the recording.
void write_motion(YAML::Emitter& out, const Recording& shown, double delay_s) {
  if (!shown.scenario.empty()) {
    const YAML::Node run = load_yaml(shown.scenario);
    for (const char* key : {"motion", "start_rad", "keyframe", "duration_s"})
      if (run[key]) out << YAML::Key << key << YAML::Value << run[key];
    return;
  }
  out << YAML::Key << "motion" << YAML::Value << YAML::Flow << YAML::BeginMap;
  out << YAML::Key << "type" << YAML::Value << "recording" << YAML::Key << "file" << YAML::Value
      << fs::absolute(shown.file).string();
  out << YAML::Key << "delay_s" << YAML::Value << delay_s << YAML::EndMap;
}

/// A scenario in which the twin follows the first recording.
std::string scenario_of(const Results& r, const SimulationFit& f, const VariantTwins& twins) {
  const Variant& variant = r.campaign.plan.variants[f.variant];
  const Recording& shown = r.campaign.plan.recordings[0];
  YAML::Emitter out;
  out.SetDoublePrecision(17);
  out << YAML::BeginMap << YAML::Key << "description" << YAML::Value
      << fmt::format("{}: found by tribotwin calibrate {}", variant.label, r.campaign.file.filename().string());
  out << YAML::Key << "model" << YAML::Value << variant.label + ".xml";
  write_motion(out, shown, twins.delay_s(f.values));
  write_control(out, variant, f, shown);
  const auto temperature_degC = twins.temperature_degC(shown);
  if (temperature_degC.size() > 1)
    out << YAML::Key << "temperature_degC" << YAML::Value << YAML::Flow << temperature_degC;
  else if (shown.temperature_degC)
    out << YAML::Key << "temperature_degC" << YAML::Value << *shown.temperature_degC;
  if (shown.bench.payload)
    out << YAML::Key << "events" << YAML::Value << YAML::Flow << YAML::BeginSeq << YAML::BeginMap << YAML::Key << "type"
        << YAML::Value << "payload" << YAML::Key << "time_s" << YAML::Value << 0 << YAML::Key << "mass_kg"
        << YAML::Value << shown.bench.payload->mass_kg << YAML::Key << "com_m" << YAML::Value
        << std::vector(shown.bench.payload->com_m.begin(), shown.bench.payload->com_m.end()) << YAML::EndMap
        << YAML::EndSeq;
  if (variant.timestep_s) out << YAML::Key << "timestep_s" << YAML::Value << *variant.timestep_s;
  out << YAML::Key << "telemetry_rate_hz" << YAML::Value << 250 << YAML::EndMap;
  return std::string(out.c_str()) + "\n";
}

}  // namespace

Result<void> write_twin(const Results& r, const SimulationFit& f, const fs::path& directory, Existing existing) {
  const Variant& variant = r.campaign.plan.variants[f.variant];
  const auto opened = VariantTwins::open(variant);
  if (!opened) return tl::unexpected(opened.error());
  const auto made = opened->candidate(f.values);
  if (!made) return tl::unexpected(made.error());
  const mujoco::Model& model = *made->models[0];
  const auto write = [&](const std::string& ending, const std::string& text) {
    return write_derived(directory / (variant.label + ending), text, existing);
  };
  if (const auto ok = write(".xml", opened->mjcf(f.values, r.campaign.plan.recordings[0].bench)); !ok) return ok;
  if (const auto ok = write(".yaml", scenario_of(r, f, *opened)); !ok) return ok;
  for (std::size_t i = 0; i < model.drives().size(); ++i) {
    const std::string joint = model.drives().size() > 1 ? "." + joint_name(model.get(), model.drives()[i]) : "";
    if (const auto ok = write(joint + ".params.yaml", to_yaml(parameter_file(r, f, model, i))); !ok) return ok;
  }
  return {};
}

Result<std::vector<std::string>> warnings_of(const Results& r, const SimulationFit& f) {
  const Variant& variant = r.campaign.plan.variants[f.variant];
  const auto twins = VariantTwins::open(variant);
  if (!twins) return tl::unexpected(twins.error());
  const auto made = twins->candidate(f.values);
  if (!made) return tl::unexpected(made.error());
  struct Warned {
    HealthLine first;
    std::string file;
    std::size_t recordings = 0;
  };
  std::vector<Warned> all;
  const auto& recordings = r.campaign.plan.recordings;
  for (const Recording& recording : recordings) {
    const auto findings = twins->health(*made, recording);
    if (!findings) return tl::unexpected(findings.error());
    for (const HealthLine& line : health_lines(*findings)) {
      if (line.verdict != Verdict::warning) continue;
      auto known = std::ranges::find(all, line.check, [](const Warned& w) { return w.first.check; });
      if (known == all.end()) known = all.insert(known, {line, recording.file.filename().string()});
      ++known->recordings;
    }
  }
  std::vector<std::string> sentences;
  for (const Warned& w : all)
    sentences.push_back(fmt::format("{}: {} of {} recordings, first {}: {}", variant.label, w.recordings,
                                    recordings.size(), w.file, w.first.text));
  return sentences;
}

}  // namespace tribotwin::twin::program
