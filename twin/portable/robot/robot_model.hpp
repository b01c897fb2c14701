#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <tribotwin/twin/portable/fmu.hpp>

namespace tribotwin::twin {

/// Internal to portable/robot: a model as files that need no other: FOLDER/model.xml, its includes merged, and its
/// meshes, height fields and textures as they are. Fails on files that the model names in another way.
Result<std::vector<FmuFile>> model_files(const std::filesystem::path& file, const std::string& folder);

}  // namespace tribotwin::twin
