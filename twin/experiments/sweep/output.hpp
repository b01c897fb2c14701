#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/twin/experiments/sweep/statistics.hpp>
#include <tribotwin/twin/simulation/run.hpp>

/// What a sweep keeps of a run: numbers of summary.json, figures of the telemetry, and telemetry at given times.
namespace tribotwin::twin::sweep {

/// A channel of a joint's telemetry, JOINT.CHANNEL; those of work cycles begin with cycle_.
struct Signal {
  std::string name;
  std::size_t drive = 0, channel = 0;
  bool of_cycles = false;
};

/// The signal of a name. ErrorKind::input with what would be right, also where the run of the scenario does not have
/// the signal at all times: a multi-rate run has only channels of work cycles.
Result<Signal> find_signal(const std::string& name, const Scenario& scenario);

/// A figure of a signal over the run.
enum class Figure { max, min, max_abs, mean, rms, time_above, time_below };
struct FigureInfo {
  std::string_view name;
  Figure figure;
  bool with_threshold;
  std::string_view meaning;
};
std::span<const FigureInfo> figures();

struct Output {
  std::string name;               ///< of its column
  std::vector<std::string> path;  ///< into summary.json; empty: a figure of telemetry
  Figure figure = Figure::max;
  Signal signal;
  double threshold = 0;  ///< of time_above, time_below
  Range range{};         ///< what the value can be
};

/// The output of an expression: a path with dots (joints.joint2.temperature_degC.end), or FIGURE(JOINT.CHANNEL) or
/// FIGURE(JOINT.CHANNEL, THRESHOLD). ErrorKind::input with what would be right. `summary`: of a run of the scenario,
/// however short.
Result<Output> parse_output(const std::string& name, const std::string& expression, const Scenario& scenario,
                            const Summary& summary);

/// Collects outputs and bands of one run.
class Collector {
 public:
  /// `times_s` ascending. References must outlive the collector.
  Collector(const Scenario& scenario, std::span<const Output> outputs, std::span<const Signal> bands,
            std::span<const double> times_s);
  /// Lets the run fill this collector.
  void listen(RunOptions& options);

  /// Per output; NaN where the run does not have it.
  std::vector<double> outputs(const Summary& summary) const;
  /// Per band and time: linear between the samples on both sides, exact at a sample; NaN outside of the record.
  std::vector<std::vector<double>> bands() const { return values_; }

 private:
  struct Sum {
    double max, min, max_abs = 0, integral = 0, square = 0, beyond_s = 0, time_s = 0;
  };
  struct Track {
    std::size_t next = 0;
    double time_s = 0, value = 0;
    bool begun = false;
  };
  void add(bool of_cycles, double time_s, double duration_s, std::span<const double> row, std::size_t width);
  void follow(std::size_t band, double time_s, double value);

  const Scenario& scenario_;
  std::span<const Output> outputs_;
  std::span<const Signal> bands_;
  std::span<const double> times_s_;
  std::vector<Sum> sums_;      ///< per output
  std::vector<Track> tracks_;  ///< per band
  std::vector<std::vector<double>> values_;
  std::vector<double> row_, cycle_row_;
  double sample_s_, last_cycle_s_ = 0;
};

}  // namespace tribotwin::twin::sweep
