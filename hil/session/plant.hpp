#pragma once

#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/hil/drives/bus_drive.hpp>
#include <tribotwin/hil/drives/drive_parameters.hpp>
#include <tribotwin/hil/drives/wiring.hpp>
#include <tribotwin/hil/faults/faults.hpp>
#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/simulation/recorder.hpp>

/// The robot behind the drives: a commanded twin, stepped between the bus and the telemetry.
namespace tribotwin::hil {

/// The drives of a scenario as a bus needs them; node numbers count up from `first_node` on each bus.
std::vector<DriveParameters> drive_parameters(const twin::Scenario& scenario, int first_node, std::uint32_t cycle_us,
                                              const Wiring& wiring = {});

class Plant {
 public:
  explicit Plant(const twin::Scenario& scenario)
      : scenario_(scenario),
        twin_(scenario, twin::Twin::commanded),
        steps_per_sample_(twin::steps_per_sample(scenario)) {}
  /// Also writes telemetry.h5 and scenario.yaml, and summary.json at `finish`. Fails where the folder holds a record
  /// that may not be replaced (ErrorKind::input) or cannot be written (ErrorKind::work).
  Result<void> record(const std::filesystem::path& directory, twin::Existing existing);
  /// Why the record ended early (full disk); the robot continues. Empty while nothing is lost.
  const std::string& record_failure() const { return record_failure_; }

  /// `sample` gets what telemetry.h5 would hold, also without a record, after each step that it has a sample of;
  /// time_s is that of its start.
  void watch(std::function<void(const twin::Twin&, double time_s)> sample) { sample_ = std::move(sample); }
  /// Passes the state of the joints to the drives.
  void show(std::span<const std::unique_ptr<BusDrive>> drives);
  /// Length of a simulation step.
  std::int64_t step_ns() const { return std::llround(1e9 * twin_.model()->opt.timestep); }
  /// One simulation step: set points from the drives, feedback to them.
  Result<void> step(std::span<const std::unique_ptr<BusDrive>> drives);
  /// As many steps as `us` microseconds have, unless `stop` (may be empty) ends a long cycle: 1006h may ask for an
  /// hour. Parts of steps are kept for the next call.
  Result<void> advance(std::span<const std::unique_ptr<BusDrive>> drives, std::int64_t us,
                       const std::function<bool()>& stop = {});
  /// Closes the record, complete or interrupted. `warnings`: further ones for summary.json.
  Result<void> finish(double wall_s, bool interrupted = false, const std::vector<std::string>& warnings = {});

  twin::Twin& twin() { return twin_; }
  const twin::Twin& twin() const { return twin_; }
  const twin::Scenario& scenario() const { return scenario_; }
  /// An injected fault begins or ends: the encoder keeps its last value, the drive reports another temperature, or the
  /// safety circuit takes the torque away.
  void impose(const DriveFault& fault);
  /// Something happens now: an entry of a scenario's `events` without its time. The record has it too, in
  /// scenario.yaml. Throws twin::InputError, and then nothing happened.
  void happen(const YAML::Node& event);

 private:
  Feedback feedback(std::size_t i) const;
  const twin::Scenario& scenario_;
  twin::Twin twin_;
  std::unique_ptr<twin::Recorder> recorder_;
  std::function<void(const twin::Twin&, double)> sample_;
  std::int64_t steps_per_sample_;
  std::string record_failure_;
  std::int64_t left_us_ = 0;
  std::vector<std::optional<double>> frozen_rad_ = std::vector<std::optional<double>>(twin_.model().drives().size());
  std::vector<std::optional<double>> override_degC_ = std::vector<std::optional<double>>(twin_.model().drives().size());
  std::vector<bool> torque_off_ = std::vector<bool>(twin_.model().drives().size());
  std::vector<bool> held_ = std::vector<bool>(twin_.model().drives().size());
};

}  // namespace tribotwin::hil
