#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/twin/simulation/health.hpp>

/// The results of a run in figures, and summary.json.
namespace tribotwin::twin {

struct JointSummary {
  std::string name;
  struct {
    double start, end, max;
  } temperature_degC;
  struct Winding {
    double start_degC, end_degC, max_degC;
    double copper_loss_J, to_gear_J;  ///< made in the winding; of it, what has flowed to the gear: a part of its heat
  };
  std::optional<Winding> winding;
  struct {
    double rms, max;
  } friction_nm;  ///< [Nm; N of a slide]
  double load_max_norm;
  std::int64_t clamped_samples;  ///< steps outside the range of the law, skipped ones included
  double outside_s;              ///< the same as time
  double stuck_s;                ///< held by friction, in skipped cycles too
  bool slide;                    ///< its friction and load are forces
};

struct Comparison {
  double mae_mrad, baseline_mae_mrad;
};

/// How well the arm behind a transmission followed its set point (TrackingError).
struct TrackingSummary {
  double temperature_degC;   ///< at the start
  std::string compensation;  ///< none, static, proposed
  double l1_mrad, standstill_pp_mrad;
};

/// The last whole period of a transmission's torque under a periodic load.
struct LoopSummary {
  double frequency_hz, temperature_degC;
  double area_J;            ///< of torque over torsion
  double torque_nm;         ///< max |torque|
  double stiffness_nm_rad;  ///< slope between the extreme torsions of the loop
};

/// Accepted residual of the energy balance: share of the friction work, and absolute.
constexpr double balance_share = 0.01, balance_floor_J = 1e-3;

struct Summary {
  double simulated_s, wall_s;
  std::int64_t steps, steps_computed;
  std::uint64_t seed;
  double friction_work_J, heat_J, motor_work_J;
  double energy_balance_J;  ///< residual of the mechanical balance (Twin::balance_J)
  std::vector<JointSummary> joints;
  std::vector<Finding> health;
  std::vector<std::string> warnings;  ///< beside those of the health check
  std::optional<Comparison> comparison;
  std::vector<TrackingSummary> tracking;
  std::vector<LoopSummary> loops;
  std::string finished_at{};  ///< UTC, ISO 8601; empty where nobody asked the clock
  bool interrupted = false;   ///< the run ended before the scenario did
};

/// The figures of a twin so far. `record_bytes`: predicted size of telemetry.h5, 0 where nothing is recorded.
Summary summarize(const Twin& twin, double wall_s, double record_bytes = 0);
/// All warnings: the lines of the health check, then the others.
std::vector<std::string> all_warnings(const Summary& summary);
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

}  // namespace tribotwin::twin
