#pragma once

#include <atomic>
#include <ctime>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/simulation/recorder.hpp>

namespace tribotwin::twin {

/// A run that goes on, for who watches it.
class RunningTwin {
 public:
  virtual ~RunningTwin() = default;
  virtual const Twin& twin() const = 0;
  /// Something happens now: an entry of `events` without its time. It is also added to scenario.yaml of the directory,
  /// so that a run of that file repeats it. Throws InputError, and then nothing happened.
  virtual void happen(YAML::Node event) = 0;
};

struct RunOptions {
  std::filesystem::path directory;          ///< empty: nothing is written
  Existing existing = Existing::refuse;     ///< what happens to a run that the directory holds
  bool realtime = false;                    ///< not faster than the clock
  const std::atomic<bool>* stop = nullptr;  ///< when true, ends the run after the current step
  std::function<void(double share, double seconds_left)> progress;
  /// What telemetry.h5 would hold, also without a directory: after each step that it has a sample of (time_s is that of
  /// its start), and at the end of each work cycle, skipped ones included.
  std::function<void(const Twin&, double time_s)> sample;
  std::function<void(double time_s, std::span<const CycleSample>)> cycle;
  /// Asked before each step: true makes it wait, and is asked again. Time that it waited does not count.
  std::function<bool(RunningTwin&)> held;
  /// A complete run, before its summary.json is written. An error ends it without a summary.
  std::function<Result<void>(const Summary&)> complete;
  std::function<std::time_t()> now;  ///< the clock of the summary's date; without it there is no date
};

/// Runs a scenario to its end. With a directory: telemetry.h5 grows during the run; summary.json is written last and
/// says whether the run was interrupted. Fails with ErrorKind::input only where the directory holds a run that may not
/// be replaced.
Result<Summary> run(const Scenario& scenario, const RunOptions& options);

}  // namespace tribotwin::twin
