#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <pugixml.hpp>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>

/// A robot of somebody else: any MJCF or URDF that the engine reads, as one MJCF document and as what the engine made
/// of it.
namespace tribotwin::twin {

/// <limit> of a URDF joint; 0: not given.
struct UrdfLimit {
  double effort_nm = 0, speed_rad_s = 0;
};

struct ForeignModel {
  /// Includes are merged; folders of assets are absolute.
  std::unique_ptr<pugi::xml_document> document;
  std::shared_ptr<const mujoco::Model> model;
  std::map<std::string, UrdfLimit> limits;   ///< by joint
  std::vector<std::filesystem::path> files;  ///< what was read, the main file first
  std::vector<std::string> notes;            ///< what was changed so that the engine reads it
};

/// Fails on text that is no MJCF or URDF, on what the engine refuses (with the version that would read it, where one is
/// known) and on a model that has drives already. A URDF becomes MJCF by the engine's own conversion: meshes are looked
/// up as URDF's package:// and relative names, and those that do not exist or have a format that the engine does not
/// read are left out with a note.
Result<ForeignModel> read_foreign_model(const std::filesystem::path& file);

/// The joint elements of a document in the engine's order, own joints of a body before those of its children.
std::vector<pugi::xml_node> joint_elements(const pugi::xml_document& document);

/// Asset folders and absolute asset files of the document become relative to `folder`.
void make_assets_relative(pugi::xml_document& document, const std::filesystem::path& folder);

}  // namespace tribotwin::twin
