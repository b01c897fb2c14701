#pragma once

#include <filesystem>
#include <string>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/folder_lock.hpp>

namespace tribotwin::twin {

/// The folder that a run writes into: created if needed, locked against other processes, and never in place of an
/// earlier run unless that was asked for. A run that is to be replaced is set aside in the folder `replaced`, where it
/// stays whole until the new one is.
class RunFolder {
 public:
  RunFolder() = default;
  RunFolder(const RunFolder&) = delete;
  RunFolder& operator=(const RunFolder&) = delete;
  /// Without commit(): brings back what was set aside where nothing new has taken its place.
  ~RunFolder();

  /// Fails where the folder holds a run that may not be replaced (ErrorKind::input), and where another process writes
  /// into it (ErrorKind::work).
  Result<void> open(const std::filesystem::path& directory, Existing existing);
  /// The new run has its record: from now on a failure leaves both, the old one in `replaced`.
  void keep_both() { restore_ = false; }
  /// The new run is whole: removes what it replaces.
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
