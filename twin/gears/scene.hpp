#pragma once

#include <string>
#include <vector>

#include <mujoco/mujoco.h>
#include <pugixml.hpp>

/// Light and ground for pictures and for robots that stand.
namespace tribotwin::twin {

/// Adds a light where the model has none and a floor where the world has no plane: under the lowest geom, without
/// contacts for a fixed base; at height 0 with contacts for a floating one.
void add_scene(pugi::xml_document& document, const mjModel* m, bool fixed_base, std::vector<std::string>& notes);

/// Excludes contacts between neighbours in a chain that overlap in the first keyframe (at 0 without one) or in most of
/// 50 random poses. The engine does so by itself, but not next to a base that is fixed to the world. Returns whether
/// anything was written.
bool exclude_neighbours(pugi::xml_document& document, const mjModel* m, std::vector<std::string>& notes);

}  // namespace tribotwin::twin
