#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <tribotwin/twin/simulation/scenario.hpp>

/// How the sections of a scenario file are read, for load_scenario. Everything throws InputError.
namespace tribotwin::twin {

/// Position of a joint [rad], or [m] of a slide.
constexpr Bounds positions{-1e4, 1e4};
/// Of a run and of a cycle [s]: thirty years.
constexpr double longest_s = 1e9;

/// A file named by `key` of a mapping. Its absolute path also replaces the value in the tree, for the resolved
/// scenario.
std::filesystem::path resolve_file(const std::filesystem::path& folder, Mapping& mapping, YAML::Node node,
                                   const std::string& key);

/// Values per drive: from a number for all, a list, or a mapping by joint name; `values` where the key is missing.
std::vector<double> per_drive(Mapping& in, const std::string& key, const mujoco::Model& model,
                              std::vector<double> values, Bounds bounds = {});

/// The key `text` of a marker.
std::string read_marker(Mapping& in);

/// Sets motion and start pose, and what follows from the motion: recording, duration.
void read_motion(Mapping in, Scenario& scenario, const std::filesystem::path& folder, YAML::Node node);

/// Reads the section `control`; needs the motion.
void read_control(Mapping& in, Scenario& scenario);

/// Per drive.
std::vector<DcPositionOptions> dc_position_options(Mapping& in, const Scenario& scenario);

}  // namespace tribotwin::twin
