#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/simulation/twin.hpp>

/// What a run leaves in its folder.
namespace tribotwin::twin {

struct JointSummary {
  std::string name;
  struct {
    double start, end, max;
  } temperature_degC;
  struct {
    double rms, max;
  } friction_nm;
  double load_max_norm;
  std::int64_t clamped_samples;
  double stuck_s;
};

struct Comparison {
  double mae_mrad, baseline_mae_mrad;
};

/// A drive behind a transmission that followed its set point (TrackingError).
struct TrackingSummary {
  double temperature_degC;   ///< at the start
  std::string compensation;  ///< none, static, proposed
  double l1_mrad, standstill_pp_mrad;
};

/// The last whole period of a transmission's torque under a load that goes to and fro.
struct LoopSummary {
  double frequency_hz, temperature_degC;
  double area_J;            ///< of torque over torsion
  double torque_nm;         ///< largest |torque|
  double stiffness_nm_rad;  ///< chord from end to end of the loop
};

constexpr double balance_share = 0.01, balance_floor_J = 1e-3;

struct Summary {
  double simulated_s, wall_s;
  std::int64_t steps, steps_computed;
  std::uint64_t seed;
  double friction_work_J, heat_J, motor_work_J;
  double energy_balance_J;  ///< what the mechanical balance leaves over
  bool balanced = true;     ///< that is below balance_share of the friction work, or below balance_floor_J
  std::vector<JointSummary> joints;
  std::vector<std::string> warnings;
  std::optional<Comparison> comparison;
  std::vector<TrackingSummary> tracking;
  std::vector<LoopSummary> loops;
  bool interrupted = false;  ///< the run was cut short
};

/// What a twin has done so far.
Summary summarize(const Twin& twin, const Scenario& scenario, double wall_s);
/// summary.json of a run.
std::string summary_json(const Summary& summary);
/// One of several runs of a scenario.
struct VariedRun {
  std::string folder;
  std::vector<std::string> settings;  ///< key=value
  Summary summary;
};
/// The summary.json over them: `runs` with folder and settings; tracking, loops and warnings of all.
std::string varied_json(std::span<const VariedRun> runs);

/// scenario.yaml, the growing telemetry.h5 and, last, summary.json of one run. Keeps other processes out of the folder.
class Recorder {
 public:
  /// `cycles`: with channels per work cycle. Throws InputError where the folder holds a run that may not be replaced.
  static Result<std::unique_ptr<Recorder>> create(const std::filesystem::path& directory, const Scenario& scenario,
                                                  bool cycles, Existing existing = Existing::refuse);
  ~Recorder();
  /// After step number `step` of the twin: records the state at its start, where the scenario's telemetry rate says so.
  Result<void> sample(const Twin& twin, std::int64_t step);
  /// Per drive: lubricant temperature [degC], mean friction power [W].
  Result<void> append_cycle(double time_s, std::span<const double> values);
  /// Closes the record and writes summary.json. A run that was replaced is removed now if this one is whole.
  Result<void> finish(const Summary& summary);
  /// Where a run that this one replaces is until then; empty if there is none.
  const std::filesystem::path& replaced() const;

 private:
  struct Impl;
  explicit Recorder(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tribotwin::twin
