#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <yaml-cpp/yaml.h>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/experiments/friction/experiment.hpp>

/// Many friction curves of one joint over load and temperature: a YAML file, read strictly. The keys are documented in
/// twin/README.md.
namespace tribotwin::twin {

enum class Procedure { plus_minus, test_cycle };

/// One curve of a campaign, ready to be measured.
struct Curve {
  std::string series;
  std::size_t number = 0;  ///< from 1, over all series
  std::size_t bench = 0;   ///< of Campaign::benches
  Measurement measurement;
  double payload_kg = 0;
  std::string conditions;  ///< "load -0.72, 50 degC", for messages
};

/// Everything checked that can be known before work begins: poses are found, temperatures of warm-ups computed.
struct Campaign {
  std::filesystem::path file;
  std::string name, description;
  std::string resolved_yaml;  ///< the same campaign with its model's path absolute and every --set applied
  std::uint64_t seed = 1;
  Procedure procedure = Procedure::plus_minus;
  std::size_t drive = 0;
  double level_noise_nm = 0;  ///< standard deviation of an error per friction level, arm side
  std::shared_ptr<const mujoco::Model> model;
  std::vector<std::shared_ptr<const mujoco::Model>> benches;
  std::vector<Curve> curves;
};

/// Reads and checks a campaign. `overrides` are key=value with dotted keys, numbers from 0 for entries of lists. Throws
/// InputError.
Campaign load_campaign(const std::filesystem::path& file, const std::vector<std::string>& overrides = {});

/// The same in two steps: the file with every override applied, and what such a tree describes (model relative to
/// `file`).
YAML::Node campaign_tree(const std::filesystem::path& file, const std::vector<std::string>& overrides);
Campaign campaign_of(const std::filesystem::path& file, YAML::Node root);

/// Columns of curves.csv: speed motor side [rad/s], torques over torque_max_nm or arm side [Nm].
inline constexpr char curve_columns[] =
    "series,curve,speed_rad_s,load_norm,temperature_degC,friction_norm,stderr_norm,friction_forward_norm,"
    "friction_backward_norm,friction_nm,stderr_nm,lag_s,ripple_nm,lost_motion_rad\n";

/// Measures one curve: its rows of curves.csv. A function of campaign and curve alone, whatever thread it runs on.
/// Fails with the curve's number, series and conditions.
Result<std::string> measured_rows(const Campaign& campaign, const Curve& curve);

}  // namespace tribotwin::twin
