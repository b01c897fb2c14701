#pragma once

#include <filesystem>
#include <functional>

#include <tribotwin/plugins/friction/error.hpp>

namespace pugi {
class xml_document;
class xml_node;
}  // namespace pugi

/// `<include file="..."/>` of MJCF, read as MuJoCo reads it: the children of the included file's root stand in its
/// place, and paths are relative to the folder of the main file.
namespace tribotwin::mujoco {

/// The document of an included file, or why there is none.
using IncludedDocument = std::function<Result<const pugi::xml_document*>(const std::filesystem::path& file)>;
/// Told of every element that was put in the place of an include.
using Copied = std::function<void(const std::filesystem::path& file, pugi::xml_node original, pugi::xml_node copy)>;

/// Merges all includes, those in included files too. Every file may occur once.
Result<void> merge_includes(pugi::xml_document& document, const std::filesystem::path& folder,
                            const IncludedDocument& included, const Copied& copied = {});

/// The same with files from the disk. Fails with the file that cannot be read or parsed.
Result<void> merge_includes(pugi::xml_document& document, const std::filesystem::path& folder);

}  // namespace tribotwin::mujoco
