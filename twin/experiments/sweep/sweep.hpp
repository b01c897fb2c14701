#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/twin/experiments/resumable_jobs.hpp>
#include <tribotwin/twin/experiments/sweep/plan.hpp>
#include <tribotwin/twin/experiments/sweep/results.hpp>

/// Many runs of a scenario, resumable: each run is a part of `complete`, a function of plan and number alone.
namespace tribotwin::twin::sweep {

/// One run in memory. A run that cannot be made is a result with status `failed`. ErrorKind::work only where `stop`
/// ended it. With a directory, which then holds its record as `tribotwin run` writes it: in place of an earlier one.
Result<RunResult> make_run(const Plan& plan, std::size_t run, const std::atomic<bool>* stop = nullptr,
                           const std::filesystem::path& directory = {});

struct SweepResult {
  std::vector<RunResult> runs;  ///< in order; fewer than the plan's where a stop rule ended the sweep
  std::size_t present = 0;      ///< of earlier calls
  std::string stopped;          ///< why it ended before the last run; empty: it did not
  std::string statistics;       ///< statistics.json
  std::vector<std::filesystem::path> files;
};

/// Where a sweep with `telemetry` keeps the record of a run.
std::filesystem::path record_of(const std::filesystem::path& directory, std::size_t run);

/// Makes the runs that the directory lacks and writes results.csv, results.h5, statistics.json and, with bands,
/// bands.csv. Stop rules are looked at after 32 runs (of a design with indices: whole base points) and each time that a
/// quarter more is there, so that the results do not depend on the number of threads. Errors as of `complete`.
Result<SweepResult> run_sweep(const Plan& plan, const LabOptions& options, const std::atomic<bool>* stop = nullptr);

/// State of a folder that a sweep works or worked in.
struct SweepStatus {
  std::size_t planned = 0, present = 0, failed = 0, warned = 0;
  bool finished = false;               ///< its results are written
  std::optional<double> seconds_left;  ///< from the pace of the runs there; none where it is unknown or finished
};

/// The runs that the folder of a sweep has, whole ones alone, by their number. Reads only.
Result<std::vector<std::optional<RunResult>>> read_runs(const Plan& plan, const std::filesystem::path& directory);

/// Reads only. ErrorKind::input where the folder holds no sweep.
Result<SweepStatus> read_status(const std::filesystem::path& directory);

}  // namespace tribotwin::twin::sweep
