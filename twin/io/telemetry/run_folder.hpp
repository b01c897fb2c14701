#pragma once

#include <filesystem>
#include <string>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/folder_lock.hpp>

namespace tribotwin::twin {

/// The folder that a run writes into: created if needed, locked against other processes, and never in place of an
/// earlier run unless that was asked for. A run that is to be replaced is moved to the folder `replaced` and stays
/// there until the new one is complete.
class RunFolder {
 public:
  RunFolder() = default;
  RunFolder(const RunFolder&) = delete;
  RunFolder& operator=(const RunFolder&) = delete;
  /// Without commit(): moves the old files back unless new ones have taken their place.
  ~RunFolder();

  /// Fails where the folder holds a run that may not be replaced (ErrorKind::input), and where another process writes
  /// into it (ErrorKind::work).
  Result<void> open(const std::filesystem::path& directory, Existing existing);
  /// Call it when the new run has its record: from then on a failure keeps both runs, the old one in `replaced`.
  void keep_both() { restore_ = false; }
  /// Call it when the new run is complete: removes the old one.
  void commit();
  /// Where the old run is; empty if there was none.
  const std::filesystem::path& aside() const { return aside_; }

 private:
  Result<void> set_aside();

  FolderLock lock_;
  std::filesystem::path directory_, aside_;
  bool created_ = false, restore_ = true;
};

}  // namespace tribotwin::twin
