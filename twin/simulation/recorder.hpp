#pragma once

#include <filesystem>
#include <memory>
#include <span>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>
#include <tribotwin/twin/simulation/channels.hpp>
#include <tribotwin/twin/simulation/summary.hpp>
#include <tribotwin/twin/simulation/twin.hpp>

/// The files that a run leaves in its folder.
namespace tribotwin::twin {

/// Steps from one sample to the next.
std::int64_t steps_per_sample(const Scenario& scenario);

/// Size that telemetry.h5 of a whole run will have [byte], within 5 %. Of a multi-rate run at least: its cycles alone,
/// because how many of them are computed is not known before.
double predicted_bytes(const Scenario& scenario);

/// What telemetry.h5 of a scenario says of it, and its channels per sample.
TelemetryOptions telemetry_options(const Scenario& scenario);

/// scenario.yaml, the growing telemetry.h5 and, last, summary.json of one run. Locks the folder against other
/// processes.
class Recorder {
 public:
  /// `cycles`: with channels per work cycle. Fails where the folder holds a run that may not be replaced, and
  /// where the disk has no room for a large record.
  static Result<std::unique_ptr<Recorder>> create(const std::filesystem::path& directory, const Scenario& scenario,
                                                  bool cycles, Existing existing = Existing::refuse);
  ~Recorder();
  /// Called after step number `step` of the twin: records it if the scenario's telemetry rate asks for it.
  Result<void> sample(const Twin& twin, std::int64_t step);
  /// One sample per drive, at the end of a work cycle.
  Result<void> append_cycle(double time_s, std::span<const CycleSample> drives);
  /// Adds an entry of `events` to scenario.yaml, so that a run of it repeats what happened.
  Result<void> add_event(const YAML::Node& event);
  /// Closes the record and writes summary.json. A complete run removes the run that it replaces.
  Result<void> finish(const Summary& summary);
  /// The folder that keeps a replaced run until then; empty if there is none.
  const std::filesystem::path& replaced() const;

 private:
  struct Impl;
  explicit Recorder(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Something happens to a twin now: an entry of `events` without its time, of a run that lasts `duration_s`. It is
/// also added to scenario.yaml of the recorder (may be nullptr), so that a run of that file repeats it. Throws
/// InputError, and then nothing happened.
void happen(Twin& twin, Recorder* recorder, YAML::Node event, double duration_s);

}  // namespace tribotwin::twin
