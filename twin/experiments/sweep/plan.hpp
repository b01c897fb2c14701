#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <yaml-cpp/yaml.h>

#include <tribotwin/twin/experiments/sweep/design.hpp>
#include <tribotwin/twin/experiments/sweep/factor.hpp>
#include <tribotwin/twin/experiments/sweep/output.hpp>
#include <tribotwin/twin/experiments/sweep/parameter_set.hpp>

/// A sweep as its YAML file describes it: many runs of one scenario.
namespace tribotwin::twin::sweep {

constexpr double most_runs = 1e7;

struct Plan {
  std::filesystem::path file, scenario;
  std::string name, description;    ///< name: of its file; empty where the plan is that of a sweep's folder
  std::vector<std::string> common;  ///< key=value, of every run
  std::vector<Factor> factors;
  std::vector<ParameterSet> parameters;
  DesignType type = DesignType::grid;
  std::size_t runs = 0;    ///< that the design has
  std::size_t asked = 0;   ///< of the plan; more than `runs` where a design with indices does not come out even
  std::uint64_t seed = 1;  ///< of the design
  std::optional<Saltelli> saltelli;
  std::vector<double> points;  ///< of unit_points; empty for a grid
  std::vector<Output> outputs;
  std::vector<Signal> bands;
  std::vector<double> band_times_s;
  std::vector<double> quantiles;
  std::vector<std::pair<std::size_t, double>> narrower_than;  ///< stop: output, width of the interval of its mean
  std::optional<std::size_t> failures;                        ///< stop where more runs fail
  bool telemetry = false;                                     ///< every run's record is kept
  /// Of a typical run: factors at the value that is tried first.
  std::shared_ptr<const mujoco::Model> model;
  YAML::Node resolved;  ///< all that results depend on
  std::vector<std::string> notes;

  /// Column names of the values that differ between runs: factors, then drawn parameters.
  std::vector<std::string> keys() const;
  /// The values of one run, as texts, in the order of keys().
  std::vector<std::string> values(std::size_t run) const;
  /// What makes the scenario of one run, for load_scenario.
  std::vector<std::string> settings(std::size_t run) const;
  /// Whether the values of keys() are numbers.
  std::vector<bool> numeric() const;
  /// Names of the groups of keys that vary independently of each other: each factor, each joint's parameters.
  std::vector<std::string> groups() const;
  /// Whether runs are independent draws of the same distribution, or samples that are at least as even.
  bool sampled() const { return type != DesignType::grid; }
  /// Of all runs, whether one counts in means and quantiles.
  bool independent(std::size_t run) const { return !saltelli || saltelli->independent(run); }
};

/// Reads and checks a plan: every key, a typical scenario and those at the ends of each factor. The campaign.yaml of a
/// sweep's folder is a plan too, refused where scenario, model or parameters have changed since.
/// ErrorKind::input with file, line, key and what would be right.
Result<Plan> load_plan(const std::filesystem::path& file);

}  // namespace tribotwin::twin::sweep
