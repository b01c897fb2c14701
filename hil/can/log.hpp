#pragma once

#include <filesystem>
#include <fstream>
#include <string>

#include <tl/expected.hpp>

#include <tribotwin/hil/can/frame.hpp>

/// candump's log format: "(1700000000.123456) vcan0 601#4041600000000000", one frame per line; FD frames "ID##<flags><data>".
namespace tribotwin::hil {

/// Reads frame by frame. Blank lines are skipped; a direction mark (T, R) after the frame is accepted.
class LogReader {
 public:
  static tl::expected<LogReader, std::string> open(const std::filesystem::path& file);
  /// The next frame: true. The end: false. A line that is no frame: an error with file and line; reading may go on.
  tl::expected<bool, std::string> next(Frame& frame);
  /// Bus named in the line last read.
  const std::string& bus() const { return bus_; }
  std::size_t line() const { return line_; }

 private:
  std::filesystem::path file_;
  std::ifstream in_;
  std::string bus_;
  std::size_t line_ = 0;
};

/// Parses one line. Fails with what is wrong in it.
tl::expected<Frame, std::string> parse_log_line(std::string_view line, std::string& bus);

/// Writes what candump -L writes, with the 6 decimals of a second that all its readers understand.
class LogWriter {
 public:
  static tl::expected<LogWriter, std::string> create(const std::filesystem::path& file, std::string bus);
  /// Fails once the file cannot take more (full disk); the message names it.
  tl::expected<void, std::string> write(const Frame& frame);
  tl::expected<void, std::string> flush();

 private:
  std::filesystem::path file_;
  std::ofstream out_;
  std::string bus_;
};

}  // namespace tribotwin::hil
