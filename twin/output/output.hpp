#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include <tl/expected.hpp>

/// What all programs of the project share towards their user: exit codes, messages, progress, files whole or not at all.
namespace tribotwin::twin {

enum Exit { done = 0, failed = 1, wrong_input = 2, limit_exceeded = 3 };

/// Prints "PROGRAM: MESSAGE" to stderr and returns the code.
int complain(std::string_view program, Exit code, std::string_view message);

/// Writes a file through FILE.partial, so that FILE is either the old or the whole new one. The message names the file.
tl::expected<void, std::string> write_file(const std::filesystem::path& file, std::string_view bytes);

/// One line on stderr that is rewritten, on terminals only.
class Progress {
 public:
  explicit Progress(bool quiet = false, std::string what = {});
  Progress(const Progress&) = delete;
  ~Progress();
  /// share 0..1; seconds left below 0 are unknown.
  void operator()(double share, double seconds_left = -1);

 private:
  std::string what_;
  bool on_, shown_ = false;
  int last_ = -1;
};

}  // namespace tribotwin::twin
