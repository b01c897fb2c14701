#pragma once

#include <string>
#include <string_view>
#include <utility>

#include <fmt/format.h>

/// The user interface that all programs share: exit codes, messages, progress. Nothing here throws when a stream is
/// closed, full or slow: `finish` reports a lost result, and lost messages are ignored.
namespace tribotwin::twin {

enum Exit { done = 0, failed = 1, wrong_input = 2, limit_exceeded = 3 };

/// First call of every main(). Writing to a closed pipe or beyond a file size limit becomes an error instead of a
/// signal. A signal that ends the program removes what is temporary (interrupt.hpp). Child processes can be waited for,
/// also where the caller ignores SIGCHLD. A standard stream that was closed is replaced by one that fails, so that no
/// opened file gets its number.
void prepare_streams();

/// Text to stdout (results only) and to stderr (everything else), whole, also into a pipe that is slow. Control
/// characters but newline and tab are shown as \\xNN: names come from files of users, and a terminal would obey them.
/// In messages that is so behind "note:" and "warning:" at their beginning, which are coloured where the stream is.
void print_text(std::string_view text);
void report_text(std::string_view text);

/// When text is coloured: on terminals without NO_COLOR, or as the last of `arguments` that says --color (--colour)
/// always or never. Before it is called nothing is coloured.
void choose_colour(int argc, const char* const* argv);
enum class Stream { output, messages };
bool coloured(Stream stream);
/// The text, bold where that stream is coloured.
std::string bold(std::string_view text, Stream stream);

/// A part of the result, to stdout.
template <class... Arguments>
void print(fmt::format_string<Arguments...> format, Arguments&&... arguments) {
  print_text(fmt::format(format, std::forward<Arguments>(arguments)...));
}

/// "note: MESSAGE" on stderr.
template <class... Arguments>
void note(fmt::format_string<Arguments...> format, Arguments&&... arguments) {
  report_text("note: " + fmt::format(format, std::forward<Arguments>(arguments)...) + "\n");
}

/// Prints "PROGRAM: MESSAGE" to stderr and returns the code.
int report_error(std::string_view program, Exit code, std::string_view message);

/// From now on nothing is printed: another process of the same job says it. The last message of report_error is kept.
void hold_output_back();
const std::string& held_error();

/// The exit code of a program that ends with `code`: 1, with a message, if stdout did not take the whole result.
int finish(std::string_view program, int code);

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
