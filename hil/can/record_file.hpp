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
  /// Also where the file holds something already. That stays until the first line is written, and from then on as
  /// FILE.replaced (or -2, -3, ...), until the new content is whole.
  bool replace = false;
  /// Asked every 0.1 s while the reader of a pipe does not read: give up? Empty: yes, because a session cannot wait for
  /// it.
  std::function<bool()> give_up;
};

/// Only whole lines reach the file, also when the disk is full. A file that holds something is not touched without
/// `replace`, and one that another session writes never is.
class RecordFile {
 public:
  static Result<RecordFile> create(const std::filesystem::path& file, RecordOptions options = {});
  RecordFile(RecordFile&&) noexcept = default;
  RecordFile& operator=(RecordFile&&) noexcept = default;
  ~RecordFile();  ///< without finish(): flushes; a new file without a line is removed

  /// Whole lines. They reach the file 0.25 s later at most, if lines go on coming. After a failure (full disk) every
  /// further call fails alike; the message names the file.
  Result<void> append(std::string_view lines);
  Result<void> flush();
  /// Flushes, waits until the disk has it, closes.
  Result<void> finish();

 private:
  RecordFile(std::filesystem::path file, RecordOptions options, twin::Descriptor fd, bool created);
  Result<void> fail(int error);
  Result<void> begin();
  bool reader_takes_more();

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
