#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <fstream>
#include <iterator>
#include <string_view>

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <tribotwin/render/report/record/cycles.hpp>
#include <tribotwin/render/report/record/run_data.hpp>
#include <tribotwin/render/theme/theme.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::render {
namespace {

namespace fs = std::filesystem;

std::optional<std::string> text_of(const fs::path& file) {
  auto text = twin::read_text(file, "a file");
  return text ? std::optional(std::move(*text)) : std::nullopt;
}

/// Of friction; NaN where it is not known.
double mean_power_w(const RunData& run, const JointHistory& j) {
  double sum = 0, count = 0;
  for (const double power :
       has_cycles(run) ? run.record.channel(j.name, "cycle_friction_power_W") : std::span<const double>())
    if (std::isfinite(power)) sum += power, ++count;
  if (count > 0) return sum / count;
  for (std::size_t i = 0; i < std::min(j.friction_nm.size(), j.velocity_rad_s.size()); ++i) {
    const double power = std::abs(j.friction_nm[i] * j.velocity_rad_s[i]);
    if (std::isfinite(power)) sum += power, ++count;
  }
  return sum / count;
}

void add_joints(RunData& run) {
  const auto drives = run.model() ? run.model()->drives() : std::span<const mujoco::Binding>();
  for (std::size_t i = 0; i < run.record.joints.size(); ++i) {
    const std::string& name = run.record.joints[i];
    const auto channel = [&](const char* what) { return run.record.channel(name, what); };
    JointHistory joint{.name = name,
                       .position_rad = channel("position_rad"),
                       .velocity_rad_s = channel("velocity_rad_s"),
                       .friction_nm = channel("friction_nm"),
                       .load_nm = channel("load_nm"),
                       .temperature_degC = channel("temperature_degC"),
                       .winding_degC = channel("winding_temperature_degC"),
                       .torsion_rad = channel("torsion_rad"),
                       .transmission_torque_nm = channel("transmission_torque_nm"),
                       .arm_position_rad = channel("arm_position_rad"),
                       .arm_set_point_rad = channel("arm_set_point_rad")};
    if (i < run.record.joint_attributes.size())
      for (const auto& [key, value] : run.record.joint_attributes[i]) {
        if (key == "gear_ratio") joint.gear_ratio = value;
        if (key == "torque_max_nm") joint.torque_max_nm = value;
      }
    const auto& channels = run.record.channels;
    if (const auto at = std::ranges::find(channels, "friction_nm", &twin::Channel::name); at != channels.end())
      joint.slide = run.record.units[i][static_cast<std::size_t>(at - channels.begin())] == "N";
    for (const auto& drive : drives)
      if (twin::joint_name(run.model()->get(), drive) == name)
        joint.gear_ratio = drive.drive.gear_ratio, joint.torque_max_nm = drive.drive.torque_max_nm,
        joint.slide = twin::is_slide(run.model()->get(), drive);
    for (const double v : joint.velocity_rad_s)
      if (std::isfinite(v)) joint.speed_max_rad_s = std::max(joint.speed_max_rad_s, std::abs(v));
    joint.moved = joint.speed_max_rad_s > 1e-3;
    joint.friction_power_w = mean_power_w(run, joint);
    run.joints.push_back(std::move(joint));
  }
}

/// Whether a file may be HDF5; what is none may be of any size.
bool begins_as_hdf5(const fs::path& file) {
  constexpr std::string_view signature = "\x89HDF\r\n\x1a\n";
  std::error_code error;
  if (!fs::is_regular_file(file, error)) return false;
  std::array<char, signature.size()> begin{};
  std::ifstream(file, std::ios::binary).read(begin.data(), begin.size());
  return std::string_view(begin.data(), begin.size()) == signature;
}

/// What of a record is proven, from a copy of it; the sentence about its damage.
std::string take_part(RunData& run, const fs::path& telemetry, const std::string& why) {
  const twin::TemporaryFolder folder("tribotwin-report");
  const fs::path& copy = folder.path();
  if (copy.empty() || !begins_as_hdf5(telemetry)) return why;
  std::error_code error;
  fs::copy_file(telemetry, copy / "telemetry.h5", error);
  const auto recovered = error ? tl::unexpected(Error(error.message())) : twin::recover(copy);
  auto record = recovered ? twin::read_telemetry(copy / "telemetry.h5") : tl::unexpected(recovered.error());
  if (!record || record->time_s.empty()) return why + "; no part of it can be read";
  run.record = std::move(*record);
  return fmt::format(
      "{}. What follows is drawn from the part that is whole: {} of {} samples, up to {}. 'tribotwin recover {}' "
      "makes a plain record of them",
      why, recovered->samples, recovered->samples + recovered->lost_samples, duration(recovered->last_time_s),
      telemetry.parent_path().string());
}

}  // namespace

std::string force_unit(std::span<const JointHistory> joints, const std::function<bool(const JointHistory&)>& counts) {
  bool hinges = false, slides = false;
  for (const auto& j : joints)
    if (counts(j)) (j.slide ? slides : hinges) = true;
  return !slides ? "Nm" : !hinges ? "N" : "Nm; N of slides";
}

std::string RunData::attribute(std::string_view key) const {
  for (const auto& [name_of, value] : record.attributes)
    if (name_of == key) return value;
  return {};
}

namespace {
/// A key of the scenario for people, also where the model is gone.
std::string scenario_key(const RunData& run, const char* key) {
  try {
    const YAML::Node root = twin::parse_yaml(run.scenario_text, "scenario.yaml");
    return root.IsMap() && root[key] && root[key].IsScalar() ? root[key].Scalar() : "";
  } catch (const std::exception&) {  // the page says elsewhere that the scenario cannot be read
    return {};
  }
}
}  // namespace

std::string RunData::robot() const {
  if (std::string said = scenario_key(*this, "robot"); !said.empty()) return said;
  return model() ? std::string(model()->get()->names) : "";
}

std::string RunData::serial_number() const { return scenario_key(*this, "serial_number"); }

std::string RunData::recording_file() const {
  try {
    const YAML::Node motion = twin::parse_yaml(scenario_text, "scenario.yaml")["motion"];
    if (!motion.IsMap() || !motion["file"] || !motion["file"].IsScalar()) return {};
    return fs::path(motion["file"].Scalar()).filename().string();
  } catch (const std::exception&) {  // the page says elsewhere that the scenario cannot be read
    return {};
  }
}

std::string RunData::date() const {
  const auto at = summary.is_object() ? summary.find("finished_at") : summary.end();
  if (at != summary.end() && at->is_string()) {
    const auto said = at->get<std::string>();  // 2026-11-25T14:20:31Z
    return said.size() >= 16 ? said.substr(0, 10) + " " + said.substr(11, 5) + " UTC" : said;
  }
  if (!unfinished()) return {};
  std::error_code error;
  const auto written = fs::last_write_time(directory / "telemetry.h5", error);
  if (error) return {};
  const auto time = std::chrono::system_clock::to_time_t(std::chrono::file_clock::to_sys(written));
  return fmt::format("last written {:%Y-%m-%d %H:%M} UTC", fmt::gmtime(time));
}

std::string shown_folder(const fs::path& directory) {
  const fs::path plain = (directory / "").parent_path();
  return plain.is_absolute() ? plain.filename().string() : plain.string();
}

Result<std::unique_ptr<RunData>> load_run(const fs::path& directory) {
  if (!fs::is_directory(directory))
    return tl::unexpected(fmt::format("{}: is no folder of a run (it must hold telemetry.h5)", directory.string()));
  auto run = std::make_unique<RunData>();
  run->directory = directory;
  const auto miss = [&](std::string what) { run->missing.push_back(std::move(what)); };

  const fs::path telemetry = directory / "telemetry.h5", summary = directory / "summary.json",
                 scenario = directory / "scenario.yaml";
  std::string no_record;
  if (!fs::exists(telemetry))
    no_record = fmt::format("{}: does not exist", telemetry.string());
  else if (auto record = twin::read_telemetry(telemetry); !record)
    no_record = run->damage = take_part(*run, telemetry, record.error().message);
  else if (record->time_s.empty())
    no_record = fmt::format("{}: holds no samples yet", telemetry.string());
  else
    run->record = std::move(*record);

  if (const auto text = text_of(summary)) {
    run->summary = twin::parse_json(*text);
    if (!run->summary.is_object()) {
      run->summary = nullptr;
      miss(fmt::format("{}: is damaged (not JSON); what only the run itself computes is missing.", summary.string()));
    }
  }
  if (!run->record.time_s.empty() && !run->damage.empty()) {
    miss(run->damage);
  } else if (!no_record.empty()) {
    if (run->summary.is_null()) return tl::unexpected(no_record);
    miss(no_record + ". Poses, curves and histories are missing.");
  } else if (!run->record.complete) {
    miss(fmt::format(
        "This run has not finished: it is still being written or was ended early. What follows shows its first {}.",
        duration(run->record.time_s.back())));
  } else if (run->summary.is_null() && !fs::exists(summary)) {
    miss(fmt::format("{}: does not exist; what only the run itself computes is missing.", summary.string()));
  }

  if (const auto text = text_of(scenario)) {
    run->scenario_text = *text;
    if (auto loaded = twin::load_scenario(scenario))
      run->scenario = std::move(*loaded);
    else
      miss(fmt::format("{} Poses and the law's curves are missing.", loaded.error().message));
  } else {
    miss(fmt::format("{}: does not exist; poses and the law's curves are missing.", scenario.string()));
  }
  run->name = run->attribute("scenario");
  if (run->name.empty() && run->scenario) run->name = run->scenario->name;
  if (run->name.empty()) run->name = fs::absolute(directory).lexically_normal().filename().string();
  add_joints(*run);
  return run;
}

Result<std::vector<std::unique_ptr<RunData>>> load_runs(const fs::path& directory) {
  const fs::path file = directory / "summary.json";
  const auto summary = twin::parse_json(text_of(file).value_or(""));
  std::vector<std::unique_ptr<RunData>> runs;
  if (!summary.is_object() || !summary.contains("runs")) {
    auto run = load_run(directory);
    if (!run) return tl::unexpected(run.error());
    runs.push_back(std::move(*run));
    return runs;
  }
  try {
    for (const auto& entry : summary["runs"]) {
      const auto folder = entry.at("folder").get<std::string>();
      if (const auto why = twin::unfit_file_name(folder))
        return tl::unexpected(fmt::format("{}: folder: {}", file.string(), *why));
      auto run = load_run(directory / folder);
      if (!run) return tl::unexpected(run.error());
      (*run)->name = folder;
      (*run)->settings = twin::joined(entry.at("set").get<std::vector<std::string>>());
      runs.push_back(std::move(*run));
    }
  } catch (const nlohmann::json::exception&) {
    runs.clear();
  }
  if (runs.empty())
    return tl::unexpected(
        fmt::format("{}: `runs` must be a list of {{\"folder\": NAME, \"set\": [\"key=value\"]}}, as tribotwin run "
                    "writes it for a scenario that varies",
                    file.string()));
  return runs;
}

}  // namespace tribotwin::render
