#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

namespace tribotwin::render {

/// Joint states of a run one after the other; all columns of one length. Friction is signed, arm side.
struct JointHistory {
  std::string name;
  double gear_ratio = 1, torque_max_nm = 1;
  std::span<const double> position_rad, velocity_rad_s, friction_nm, load_nm, temperature_degC;  ///< of the record
  std::span<const double> winding_degC;  ///< empty or NaN without a winding
  /// Of a drive behind a transmission; else empty or NaN. Torsion, arm and set point are angles behind the gear.
  std::span<const double> torsion_rad, transmission_torque_nm, arm_position_rad, arm_set_point_rad;
  double speed_max_rad_s = 0;  ///< m/s of a slide
  /// Mean over the work cycles where the record has them, of which a multi-rate run has all, else over the samples; NaN
  /// without any.
  double friction_power_w = 0;
  bool slide = false;  ///< angles are lengths [m], torques forces [N]
  bool moved = false;  ///< faster than a creep: 1e-3 rad/s at the joint
};

/// The folder, without those above it where it was named absolutely.
std::string shown_folder(const std::filesystem::path& directory);

/// The unit of torques and forces of these joints: "Nm", "N" of slides, or "Nm; N of slides".
std::string force_unit(std::span<const JointHistory> joints, const std::function<bool(const JointHistory&)>& counts);

/// What a folder of `tribotwin run` holds, as much of it as can be read.
struct RunData {
  std::filesystem::path directory;
  std::string name;
  std::string settings;    ///< what made it one of several runs of a scenario: "key=value, ..."
  twin::Recording record;  ///< without samples when it could not be read
  nlohmann::json summary;  ///< null when there is none
  std::string scenario_text;
  std::optional<twin::Scenario> scenario;  ///< with the model
  std::vector<std::string> missing;        ///< what is not there, and why: sentences for the reader
  std::string damage;                      ///< the first of them where the record is damaged; `record` is what is whole
  std::vector<JointHistory> joints;        ///< points into `record`

  std::string attribute(std::string_view name) const;
  /// What the scenario calls the robot, else the name of its model; may be empty.
  std::string robot() const;
  std::string serial_number() const;   ///< of the scenario; may be empty
  std::string recording_file() const;  ///< whose motion the run repeats, without its folder; may be empty
  /// When the run ended: "2026-11-25 14:20 UTC"; of an unfinished one "last written 2026-11-25 14:20 UTC"; may be
  /// empty.
  std::string date() const;
  /// Neither damaged nor complete: still being written, or ended early.
  bool unfinished() const { return damage.empty() && !record.time_s.empty() && !record.complete; }
  const mujoco::Model* model() const { return scenario ? scenario->model.get() : nullptr; }
};

/// Of a damaged record what tribotwin recover would keep is read, from a copy. Fails when the folder has neither
/// telemetry nor a summary that can be read.
Result<std::unique_ptr<RunData>> load_run(const std::filesystem::path& directory);
/// The run in a folder or, where a scenario that varies left several there, those that its summary.json names, each
/// called by its folder's name. Fails like load_run, and on an entry that names no folder.
Result<std::vector<std::unique_ptr<RunData>>> load_runs(const std::filesystem::path& directory);

}  // namespace tribotwin::render
