#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <yaml-cpp/yaml.h>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/io/file.hpp>

/// Long work in parts that do not depend on each other, each kept as a file from the moment it is done: however a run
/// ends, the next one goes on, and the results are the same byte by byte, whatever the number of threads.
namespace tribotwin::twin {

struct LabOptions {
  std::filesystem::path directory;
  unsigned threads = 0;                  ///< 0: all cores
  Existing existing = Existing::refuse;  ///< what happens to results that were changed since they were made
  std::function<void(double share, double seconds_left)> progress;  ///< from one thread at a time
};

struct ResumableJobs {
  std::string folder;              ///< of the parts, below the directory
  std::vector<std::string> files;  ///< name of each part in it
  std::function<bool(std::size_t part, const std::string& text)>
      whole;  ///< whether a file that is there is a whole part
  std::function<Result<std::string>(std::size_t part)>
      make;  ///< from several threads; a function of campaign and part alone
};

struct Completed {
  std::vector<std::string> texts;  ///< per part
  std::size_t present = 0;         ///< of them made by an earlier run
  std::shared_ptr<void> lock;      ///< keeps other processes out of the directory
};

/// A campaign as `complete` wants it: engine and model in the first line, for another of either gives other numbers.
std::string resolved_yaml(const mujoco::Model& model, const YAML::Node& campaign);

/// Makes the parts that the directory lacks. It holds campaign.yaml with `resolved_yaml`, which says whose it is, and
/// `checksums`: a part that does not have its own there is made again. Throws InputError where the directory holds
/// another campaign or something else. Fails with the first part that cannot be made, when another process works in the
/// directory, or when a file cannot be written.
Result<Completed> complete(const std::string& resolved_yaml, const ResumableJobs& parts, const LabOptions& options);

}  // namespace tribotwin::twin
