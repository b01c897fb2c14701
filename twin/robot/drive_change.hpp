#pragma once

#include <filesystem>
#include <memory>
#include <span>
#include <string>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>

namespace tribotwin::twin {

struct DriveChange {
  std::string joint;
  drive::Configuration keys;
};

/// A model from a file with some keys of its joints' drives replaced (plugins/README.md names them). With another `law`
/// or `thermal` the parameters of the old one are removed. Works on the text of the model, which is all that engine
/// plugins read. An error names file, joint, key or value.
Result<std::shared_ptr<const mujoco::Model>> load_with_drives(const std::filesystem::path& file,
                                                              std::span<const DriveChange> changes,
                                                              const mujoco::Options& options = {});

/// The same with one drive changed.
Result<std::shared_ptr<const mujoco::Model>> load_with_drive(const std::filesystem::path& file,
                                                             const std::string& joint,
                                                             const drive::Configuration& keys);

}  // namespace tribotwin::twin
