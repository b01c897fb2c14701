#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>

#include <tribotwin/hil/can/frame.hpp>
#include <tribotwin/hil/can/record_file.hpp>
#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/descriptor.hpp>

/// candump's log format: "(1700000000.123456) vcan0 601#4041600000000000", one frame per line; FD frames
/// "ID##<flags><data>".
namespace tribotwin::hil {

/// Reads frame by frame. Blank lines are skipped; a direction mark (T, R) after the frame is accepted.
class LogReader {
 public:
  /// `stop` is polled at least every 0.1 s, also while a pipe is empty or has no writer; true ends the log.
  static Result<LogReader> open(const std::filesystem::path& file, std::function<bool()> stop = {});
  /// Reads the next frame; false at the end. Fails with file and line where a line is no frame; reading may continue.
  Result<bool> next(Frame& frame);
  /// Bus named in the line last read.
  const std::string& bus() const { return bus_; }
  std::size_t line() const { return line_; }

 private:
  /// Reads more of the file into the buffer; false at the end and after `stop`.
  Result<bool> fill();
  /// Skips the rest of a line that is too long; false at the end of the file.
  Result<bool> skip_line();
  /// The next line without its newline; false at the end of the file.
  Result<bool> next_line(std::string_view& line);

  std::filesystem::path file_;
  std::function<bool()> stop_;
  twin::Descriptor fd_;
  std::string buffer_, bus_;
  std::size_t begin_ = 0;  ///< of the unread part of the buffer
  std::size_t line_ = 0;
  bool skipping_ = false;  ///< the buffer begins in a line that is too long
  bool cut_ = false;       ///< the line last read is the last one and has no end
};

/// Parses one line. The error says what is wrong in it.
Result<Frame> parse_log_line(std::string_view line, std::string& bus);

/// Writes what candump -L writes, with the 6 decimals of a second that all its readers understand.
class LogWriter {
 public:
  static Result<LogWriter> create(const std::filesystem::path& file, std::string bus, RecordOptions options = {});
  /// Fails once the file cannot take more (full disk); the message names it.
  Result<void> write(const Frame& frame) { return write(frame, bus_); }
  /// The same, of a frame on another bus; `bus` is one word.
  Result<void> write(const Frame& frame, std::string_view bus);
  Result<void> flush() { return out_.flush(); }
  Result<void> finish() { return out_.finish(); }

 private:
  LogWriter(std::filesystem::path file, std::string bus, RecordFile out)
      : file_(std::move(file)), bus_(std::move(bus)), out_(std::move(out)) {}

  std::filesystem::path file_;
  std::string bus_;
  RecordFile out_;
};

}  // namespace tribotwin::hil
