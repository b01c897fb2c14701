#pragma once

#include <atomic>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <yaml-cpp/yaml.h>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/io/file.hpp>

/// Long work in independent parts, each written to a file when it is done: after an interruption the next run
/// continues, and the results are the same byte by byte, for any number of threads and of MPI ranks.
namespace tribotwin::twin {

struct LabOptions {
  std::filesystem::path directory;
  unsigned threads = 0;                  ///< per rank; 0: all cores, or one on each of several MPI ranks
  Existing existing = Existing::refuse;  ///< for results that were changed after they were made
  std::function<void(double share, double seconds_left)> progress;  ///< one call at a time
  int retries = 1;                                                  ///< further attempts of a part whose work failed
  const std::atomic<bool>* stop = nullptr;                          ///< when true, no further part begins
};

struct ResumableJobs {
  std::string folder;                            ///< of the parts, relative to the directory
  std::vector<std::string> files;                ///< name of each part in it
  std::pair<std::string, std::string> origin{};  ///< a file of the directory that does not identify it: name, text
  std::function<bool(std::size_t part, const std::string& text)>
      whole;  ///< whether the text of an existing file is a complete part
  std::function<Result<std::string>(std::size_t part)>
      make;  ///< called in processes of its own, on any rank; a function of campaign and part alone; may throw
  /// What stands for a part that failed, on every rank; it is not kept, so the next run tries the part again. Empty:
  /// the campaign fails.
  std::function<std::string(std::size_t part, const Error& error)> in_place_of = {};
};

/// On every rank the same, but the lock, which rank 0 has. Files are then written by rank 0 alone:
/// ranks().on_root([&] { return write_file(...); }).
struct Completed {
  std::vector<std::string> texts;  ///< per part
  std::size_t present = 0;         ///< number of parts made by an earlier run
  std::shared_ptr<void> lock;      ///< keeps other processes out of the directory
};

/// A campaign for `complete`: engine and model in the first line, as the results depend on both.
std::string resolved_yaml(const mujoco::Model& model, const YAML::Node& campaign);
/// The engine that the first line of a campaign.yaml names: "MuJoCo 2.2.2"; empty where it names none.
std::string engine_of(const std::string& campaign_yaml);

/// Makes the parts that the directory lacks, on all threads and ranks (numerics/executor); collective. The directory
/// contains campaign.yaml with `resolved_yaml`, which identifies the campaign, and `checksums`: a part without its
/// checksum there is made again. A part that fails does not end the others: failures.csv lists those that failed.
/// ErrorKind::input where the directory contains another campaign or other files. ErrorKind::work where parts failed
/// (it names the first), when another process works in the directory, or when a file cannot be written.
Result<Completed> complete(const std::string& resolved_yaml, const ResumableJobs& parts, const LabOptions& options);

}  // namespace tribotwin::twin
