#pragma once

#include <cstddef>
#include <span>
#include <string>

#include <tribotwin/plugins/mujoco/loader.hpp>

/// What a page needs to draw a robot: shapes once, poses as they come.
namespace tribotwin::twin::live {

struct GeometryLimits {
  std::size_t triangles = 150'000;  ///< of all meshes together; larger ones are simplified
  std::size_t geoms = 10'000;       ///< those beyond are left out, and counted
  int groups = 3;                   ///< what is drawn: 0, 1, 2 as MuJoCo's viewer does by default
};

/// geometry.json as twin/live/protocol/README.md says: what is in the groups and not transparent.
std::string geometry_json(const mujoco::Model& model, const GeometryLimits& limits = {});

/// Numbers of one body in a pose: position [m], quaternion w x y z.
inline constexpr std::size_t pose_numbers = 7;

/// All bodies of d, in the order of mjModel.
void read_poses(const mjModel* m, const mjData* d, std::span<float> to);

}  // namespace tribotwin::twin::live
