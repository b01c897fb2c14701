#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>

namespace tribotwin::twin {

/// A model from a file with some keys of one joint's drive replaced (plugins/README.md names them). With another `law`
/// or `thermal` the parameters of the old one go. Works on the text of the model, for engine plugins read nothing else.
/// Fails with what is wrong with file, joint, key or value.
Result<std::shared_ptr<const mujoco::Model>> load_with_drive(const std::filesystem::path& file,
                                                             const std::string& joint,
                                                             const drive::Configuration& keys);

}  // namespace tribotwin::twin
