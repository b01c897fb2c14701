#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/hil/session/bench.hpp>
#include <tribotwin/hil/shadow/listener.hpp>
#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/file.hpp>

/// Listens to the positions and torques of a real robot and predicts its torque and temperature.
namespace tribotwin::hil {

/// What was measured and predicted at one time; NaN: not known, or not judged.
struct ShadowCycle {
  double time_s = 0;
  struct Part {
    double position_rad, velocity_rad_s, measured_nm, predicted_nm, residual_nm, temperature_degC;
    bool exceeded;  ///< up to now
  };
  std::vector<Part> joints;
};

struct ShadowOptions {
  Profile profile = Profile::cia402;
  int first_node = 1;
  Wiring wiring;                     ///< the drives on each bus; all on one without
  std::function<std::size_t()> bus;  ///< of the frame last read; without: all are on one
  std::uint32_t cycle_us = 2000;     ///< in lockstep: from one SYNC to the next
  bool cycle_expected = false;       ///< the bus must have that cycle; else what it has is taken
  bool lockstep = false;             ///< the SYNC is the clock, not the frames' stamps
  /// Called once: one per joint; null, or none at all: a drive of `profile`.
  std::function<std::vector<std::unique_ptr<Listener>>()> listeners;
  std::optional<double> limit_nm;         ///< of the residual, arm side
  double limit_time_s = 0.5;              ///< time [s] for which it must be exceeded
  std::vector<std::string> limit_joints;  ///< joints to check; all if empty
  std::optional<double> duration_s;       ///< of time on the bus
  std::filesystem::path csv;  ///< every cycle: time_s, then measured, predicted, residual, temperature per joint
  twin::Existing existing = twin::Existing::refuse;  ///< what happens to an older CSV
  std::function<bool()> stop;
  bool endless = false;  ///< a live bus without duration_s: `stop` is the usual end
  std::function<void(const std::string&)> note;
  std::function<void(const ShadowCycle&)> cycle;  ///< each that the CSV has a row of
};

/// One joint, over the whole session. Torques arm side; residual = measured - predicted, both filtered alike. While a
/// joint stands, stiction holds any torque up to breakaway: then the residual is the distance to that range.
struct ShadowJoint {
  std::string name;
  std::uint64_t samples = 0;                  ///< cycles that were judged; without any, the residuals are 0
  double judged_from_s = 0, judged_to_s = 0;  ///< time of the first and the last of them
  std::uint64_t not_enabled = 0;       ///< cycles not judged: brake, stop, fault, or enabled too short a time ago
  std::uint64_t torque_missing = 0;    ///< cycles not judged: too many torques were missing around them
  std::uint64_t position_missing = 0;  ///< cycles in which no joint was judged: positions of this one were missing
  std::uint64_t positions_lost = 0, torques_lost = 0;  ///< frames that should have come
  double residual_mean_nm = 0, residual_rms_nm = 0, residual_max_nm = 0;
  double lag_s = 0;             ///< delay of the measured torque behind the predicted one (cross-correlation)
  double temperature_degC = 0;  ///< estimated, at the end
  bool exceeded = false;
};
struct ShadowResult {
  double seconds = 0;  ///< time on the bus up to the last prediction
  double heard_s = 0;  ///< time on the bus from the first frame to the last
  double cycle_s = 0;
  std::string cycle_source;  ///< where the cycle comes from: "SYNC"
  std::vector<ShadowJoint> joints;
  std::vector<std::string> unchecked;  ///< one line each: joints that the limit could not be checked on, and why
  bool interrupted = false;            ///< by `stop`, before the end
  std::string csv_failure;             ///< why the CSV ends before the session; empty if it does not
  bool exceeded() const;
  std::string table() const;
};

/// Where frames come from: a bus, or a log. Returns false at the end.
using NextFrame = std::function<Result<bool>(Frame&)>;

/// Fails when `next` or the simulation does, for a name in `limit_joints` that is no joint, for a bus with
/// another cycle than expected, and where nothing could be predicted: no position of some drive was heard, or too few
/// of all (ErrorKind::input).
Result<ShadowResult> shadow(const twin::Scenario& scenario, const NextFrame& next, const ShadowOptions& options);

}  // namespace tribotwin::hil
