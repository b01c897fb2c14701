#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/descriptor.hpp>

/// A text file that grows during a session: a candump log, a CSV.
namespace tribotwin::hil {

struct RecordOptions {
  /// Replace a file that has content. The old one stays until the first line is written, and then as FILE.replaced (or
  /// -2, -3, ...) until the new one is complete.
  bool replace = false;
  /// Polled every 0.1 s while the reader of a pipe does not read; true gives up. Empty: give up at once, because a
  /// session cannot wait.
  std::function<bool()> give_up;
};

/// Only whole lines reach the file, also when the disk is full. A file with content is not touched without `replace`,
/// and a file that another session writes never is.
class RecordFile {
 public:
  static Result<RecordFile> create(const std::filesystem::path& file, RecordOptions options = {});
  RecordFile(RecordFile&&) noexcept = default;
  RecordFile& operator=(RecordFile&&) noexcept = default;
  ~RecordFile();  ///< without finish(): flushes; a new file without a line is removed

  /// Appends whole lines. They reach the file within 0.25 s while lines keep coming. After a failure (full disk) every
  /// further call fails with the same message, which names the file.
  Result<void> append(std::string_view lines);
  Result<void> flush();
  /// Flushes, forces the file and its name to disk and closes it.
  Result<void> finish();

 private:
  RecordFile(std::filesystem::path file, RecordOptions options, twin::Descriptor fd, bool created);
  Result<void> fail(int error);
  Result<void> begin();
  bool reader_takes_more();
  Result<void> sync_name();
  Result<void> set_aside();

  std::filesystem::path file_, replaced_;
  RecordOptions options_;
  twin::Descriptor fd_;
  bool created_ = false, regular_ = false, written_ = false;
  std::string waiting_, error_;
  std::int64_t size_ = 0;  ///< of the file up to its last whole line
  std::int64_t flushed_ns_ = 0;
};

}  // namespace tribotwin::hil
