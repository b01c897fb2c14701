#pragma once

#include <filesystem>
#include <string>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/descriptor.hpp>
#include <tribotwin/twin/io/interrupt.hpp>

namespace tribotwin::twin {

/// Keeps a second process out of a folder that a command writes into, by a lock on the file run.lock. A process that
/// was ended by kill -9 leaves the file but not the lock.
class FolderLock {
 public:
  FolderLock() = default;
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;
  ~FolderLock();
  /// Fails when another process holds it, or the folder cannot be written: the message names the folder.
  Result<void> take(const std::filesystem::path& directory);
  void release();

 private:
  std::filesystem::path path_;
  Temporary temporary_;
  Descriptor file_;
};

}  // namespace tribotwin::twin
