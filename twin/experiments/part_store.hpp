#pragma once

#include <chrono>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/descriptor.hpp>

/// Internal to this folder.
namespace tribotwin::twin {

/// Finished parts on disk: a file each, and its CRC-32 as a line of DIRECTORY/checksums, appended when the file is
/// there. What a kill leaves is found whole by the next run; a part without its checksum, or one that was cut or
/// changed since, counts as missing. Data are forced to disk once a second and at the end, so a machine that loses
/// power loses the parts of the last second; forcing each would take several milliseconds.
class PartStore {
 public:
  /// The folder of the parts and `checksums` need not exist.
  static Result<PartStore> open(const std::filesystem::path& directory, const std::string& folder);

  /// The text of a part that is there as it was made.
  std::optional<std::string> find(const std::string& name) const;
  Result<void> keep(const std::string& name, std::string_view text);
  /// When no further part comes: `checksums` in the order of the names, whatever the order in which the parts came.
  Result<void> finish();

 private:
  PartStore() = default;
  Result<void> force();

  std::filesystem::path folder_, file_;
  std::map<std::string, std::string> sums_;
  std::string lines_;  ///< of the file
  Descriptor appended_;
  std::chrono::steady_clock::time_point forced_ = std::chrono::steady_clock::now();
};

}  // namespace tribotwin::twin
