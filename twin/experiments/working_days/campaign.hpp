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

/// Hao 2021's comparison: the same motion on several robots of one type, over working days that begin cold, from a YAML
/// file.
namespace tribotwin::twin::repeatability {

/// From `time_s` on, law parameters of a joint are multiplied.
struct Fault {
  std::size_t robot = 0, day = 0;  ///< from 0
  double time_s = 0;               ///< of the day
  Wear wear;
};

struct Campaign {
  std::filesystem::path file;
  std::string name, description;
  std::string resolved_yaml;  ///< the campaign with every --set applied and an absolute path of the model
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

/// The law of the joints of these robots, `polynomial`. Its first parameters f1 .. f4 are torques; a and T0 follow.
const friction::LawInfo& law_of_days();
inline constexpr std::size_t torque_parameters = 4;

/// Whether a tree is such a campaign: `procedure: working_days`.
bool is_repeatability(const YAML::Node& root);

/// Reads and checks the campaign of a tree, with every --set applied, from `file`. ErrorKind::input with file, key and
/// what would be right.
Result<Campaign> load_campaign(const std::filesystem::path& file, YAML::Node root);

/// One robot of the type, drawn by the campaign's seed.
struct Individual {
  std::shared_ptr<const mujoco::Model> model;  ///< with its masses and inertias
  std::vector<double> friction;                ///< per drive: factor of every torque of its law
};
/// ErrorKind::input where the drives do not allow the changed model.
Result<Individual> individual(const Campaign& campaign, std::size_t robot);

/// The file of a test, relative to the campaign's folder.
std::filesystem::path file_of(const Campaign& campaign, std::size_t test);

/// Ambient temperature of a day [degC].
double ambient_degC(const Campaign& campaign, std::size_t day);

/// A seed for one purpose of the campaign.
std::uint64_t seed_for(const Campaign& campaign, std::uint64_t purpose, std::uint64_t number);

}  // namespace tribotwin::twin::repeatability
