#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <yaml-cpp/yaml.h>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/robot/excitation.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

/// Paper 3's comparison: the same motion on several robots of one type, over working days that begin cold. A YAML file,
/// read strictly. The keys are documented in twin/README.md.
namespace tribotwin::twin::repeatability {

/// Something breaks: from then on law parameters of a joint are multiplied.
struct Fault {
  std::size_t robot = 0, day = 0;  ///< from 0
  double time_s = 0;               ///< of the day
  Wear wear;
};

struct Campaign {
  std::filesystem::path file;
  std::string name, description;
  std::string resolved_yaml;  ///< the same campaign with its model's path absolute and every --set applied
  std::uint64_t seed = 1;
  std::shared_ptr<const mujoco::Model> model;
  std::size_t robots = 2, days = 4;
  double duration_s = 5400;                          ///< of a day
  double ambient_degC = 20, ambient_std_K = 0;       ///< over the days
  double friction_scatter = 0, inertia_scatter = 0;  ///< standard deviations over robots, relative: friction of each
                                                     ///< joint; mass and inertia of each body, inertia of each rotor
  double encoder_increments_per_turn = 0;            ///< per turn of the joint; 0: ideal
  double torque_noise_share = 0;                     ///< standard deviation, of torque_max_nm
  double sampling_hz = 250;
  ExcitationOptions excitation;
  std::vector<Fault> faults;

  std::size_t tests() const { return robots * days; }
  std::size_t robot_of(std::size_t test) const { return test / days; }
  std::size_t day_of(std::size_t test) const { return test % days; }
};

/// Whether a campaign's file is one of these: `procedure: working_days`.
bool is_repeatability(const YAML::Node& root);

/// Reads and checks a campaign; `root` is the file's, --set applied. Throws InputError.
Campaign load_campaign(const std::filesystem::path& file, YAML::Node root);

/// One robot of the type, drawn by the campaign's seed.
struct Individual {
  std::shared_ptr<const mujoco::Model> model;  ///< with its masses and inertias
  std::vector<double> friction;                ///< per drive: factor of every torque of its law
};
/// Fails where the changed model could not carry its drives.
Result<Individual> individual(const Campaign& campaign, std::size_t robot);

/// Where a test is kept, below the campaign's folder.
std::filesystem::path file_of(const Campaign& campaign, std::size_t test);

/// Ambient temperature of a day [degC].
double ambient_degC(const Campaign& campaign, std::size_t day);

/// A seed for one purpose of the campaign.
std::uint64_t seed_for(const Campaign& campaign, std::uint64_t purpose, std::uint64_t number);

}  // namespace tribotwin::twin::repeatability
