#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/experiments/sweep/results.hpp>

/// A sweep as its folder has it, for those who show it.
namespace tribotwin::twin::sweep {

struct StoredRun {
  std::size_t number = 0;
  std::vector<std::string> values;  ///< of the keys
  std::vector<double> outputs;      ///< NaN where there is none
  std::string status, message;      ///< ok, warned, failed
  bool counts = true;               ///< in means and quantiles
};

struct StoredOutput {
  std::string name, expression;
};

struct StoredSweep {
  std::filesystem::path directory;
  std::string plan, description;  ///< name of the plan; empty where the folder does not say
  std::string campaign;           ///< campaign.yaml
  std::string engine;             ///< "MuJoCo 2.2.2"
  std::string scenario;           ///< its file
  std::string design;             ///< of design_types
  bool indices = false;           ///< the design is one for Sobol' indices
  std::optional<std::size_t> seed;
  std::size_t planned = 0;
  bool finished = false;  ///< its results are written
  std::string date;       ///< of the newest run or result, 2026-11-23, local time
  std::vector<std::string> keys;
  std::vector<StoredOutput> outputs;
  std::vector<StoredRun> runs;  ///< those that are there, ascending
  std::vector<double> probabilities, times_s;
  std::vector<Band> bands;
  nlohmann::json statistics;  ///< as in statistics.json, of the runs that are there
};

/// Reads results.csv, bands.csv and statistics.json; of an unfinished sweep the runs that are there, which needs
/// scenario, model and parameters as they were. ErrorKind::input where the folder holds no sweep or has no run yet, and
/// where a file is damaged.
Result<StoredSweep> read_sweep(const std::filesystem::path& directory);

}  // namespace tribotwin::twin::sweep
