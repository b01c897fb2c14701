#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include <tribotwin/twin/runtime/twin.hpp>

namespace tribotwin::twin {

struct RunOptions {
  std::filesystem::path directory;                    ///< empty: nothing is written
  bool realtime = false;                              ///< not faster than the clock
  std::function<void(double share, double seconds_left)> progress;
};

struct JointSummary {
  std::string name;
  struct { double start, end, max; } temperature_degC;
  struct { double rms, max; } friction_nm;
  double load_max_norm;
  std::int64_t clamped_samples;
  double stuck_s;
};

struct Comparison {
  double mae_mrad, baseline_mae_mrad;
};

struct Summary {
  double simulated_s, wall_s;
  std::int64_t steps, steps_computed;
  std::uint64_t seed;
  double friction_work_J, heat_J, motor_work_J;
  double energy_balance_J;           ///< what the mechanical balance leaves over
  std::vector<JointSummary> joints;
  std::vector<std::string> warnings;
  std::optional<Comparison> comparison;
};

/// Runs a scenario to its end. With a directory: telemetry.h5 grows while it runs, scenario.yaml is written first and
/// summary.json, which marks a whole run, last.
tl::expected<Summary, std::string> run(const Scenario& scenario, const RunOptions& options);

/// summary.json of a run.
std::string summary_json(const Summary& summary);

}  // namespace tribotwin::twin
