#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/twin/experiments/sweep/plan.hpp>
#include <tribotwin/twin/experiments/sweep/statistics.hpp>

/// What a sweep writes from its runs: tables, statistics, bands.
namespace tribotwin::twin::sweep {

struct RunResult {
  std::string status;           ///< ok; warned: its health check has a warning; failed; missing: not made yet
  std::string message;          ///< the checks that warn, or why it failed
  std::vector<double> outputs;  ///< NaN where there is none; empty where it failed
  std::vector<std::vector<double>> bands;  ///< per signal and time; empty where it failed
  bool another_attempt = false;            ///< it failed, and not because of its input; not in a line
  bool failed() const { return status == "failed"; }
};

/// One line of JSON, and back; every number is the same double. Nothing where the text is none of these.
std::string to_line(std::size_t run, const RunResult& result);
std::optional<RunResult> from_line(std::size_t run, const std::string& line);

struct Failures {
  std::size_t failed = 0, warned = 0;
  std::optional<std::size_t> first;  ///< run that failed
};
Failures failures(const std::vector<RunResult>& runs);

/// run, a column per factor and drawn parameter, a column per output, status, message.
std::string results_csv(const Plan& plan, const std::vector<RunResult>& runs);

/// Quantiles of a signal over the runs, by time.
struct Band {
  std::string signal;
  std::vector<double> runs;                    ///< that have it, per time
  std::vector<std::vector<double>> quantiles;  ///< per probability and time; NaN where no run has it
};
std::vector<Band> bands_of(const Plan& plan, const std::vector<RunResult>& runs);

/// Quantiles of each signal over time: time_s, then for each signal the number of runs that have it there and a column
/// per quantile. Empty without bands.
std::string bands_csv(const Plan& plan, const std::vector<Band>& bands);

/// The tables as HDF5: run, factors/, outputs/, status, message; bands/time_s and bands/SIGNAL/. ErrorKind::work.
Result<std::string> results_hdf5(const Plan& plan, const std::vector<RunResult>& runs, const std::vector<Band>& bands);

/// Values of an output of the runs that count in means and quantiles.
std::vector<double> sample_of(const Plan& plan, const std::vector<RunResult>& runs, std::size_t output);

/// Mean, deviation, quantiles, sensitivities of each output. `stopped`: why the sweep ended before its last run, or
/// empty.
std::string statistics_json(const Plan& plan, const std::vector<RunResult>& runs, const std::string& stopped);

}  // namespace tribotwin::twin::sweep
