#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <yaml-cpp/yaml.h>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/experiments/friction/experiment.hpp>

/// Many friction curves of one joint over load and temperature, from a YAML file. Keys: README of the scenarios.
namespace tribotwin::twin {

enum class Procedure { plus_minus, test_cycle };

/// One curve of a campaign, ready to be measured.
struct Curve {
  std::string series;
  std::size_t number = 0;  ///< from 1, over all series
  std::size_t bench = 0;   ///< of Campaign::benches
  Measurement measurement;
  double payload_kg = 0;
  std::vector<std::string> faults;  ///< names of the series' faults
  std::string conditions;           ///< for messages: "load -0.72 by pose, 50 degC"
};

/// Checked before any measurement: poses are found, temperatures of warm-ups computed, motions planned.
struct Campaign {
  std::filesystem::path file;
  std::string name, description;
  std::string resolved_yaml;  ///< the campaign with every --set applied and an absolute path of the model
  std::uint64_t seed = 1;
  Procedure procedure = Procedure::plus_minus;
  std::size_t drive = 0;      ///< of the joint, in model->drives()
  double level_noise_nm = 0;  ///< standard deviation of an additional error per friction level, arm side
  std::shared_ptr<const mujoco::Model> model;
  std::vector<std::shared_ptr<const mujoco::Model>> benches;
  std::vector<Curve> curves;
};

/// Reads and checks a campaign. `overrides` are key=value with dotted keys, numbers from 0 for entries of lists.
/// ErrorKind::input with file, key and what would be right.
Result<Campaign> load_campaign(const std::filesystem::path& file, const std::vector<std::string>& overrides = {});

/// The same in two steps: the file with every override applied, and the campaign of such a tree (model relative to
/// `file`).
Result<YAML::Node> campaign_tree(const std::filesystem::path& file, const std::vector<std::string>& overrides);
Result<Campaign> campaign_of(const std::filesystem::path& file, YAML::Node root);

}  // namespace tribotwin::twin
