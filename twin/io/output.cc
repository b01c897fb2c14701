#include <csignal>
#include <cstring>

#include <fcntl.h>
#include <unistd.h>

#include <tribotwin/twin/io/descriptor.hpp>
#include <tribotwin/twin/io/output.hpp>

namespace tribotwin::twin {
namespace {

int stdout_error = 0;  // errno of the first write to stdout that failed

}  // namespace

void prepare_streams() {
  for (const int signal : {SIGPIPE, SIGXFSZ}) std::signal(signal, SIG_IGN);
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    if (::fcntl(stream, F_GETFD) < 0) (void)::open("/dev/null", stream == STDIN_FILENO ? O_WRONLY : O_RDONLY);
}

void print_text(std::string_view text) {
  if (stdout_error == 0) stdout_error = write_all(STDOUT_FILENO, text);
}

void report_text(std::string_view text) { (void)write_all(STDERR_FILENO, text); }

int report_error(std::string_view program, Exit code, std::string_view message) {
  report_text(fmt::format("{}: {}\n", program, message));
  return code;
}

int finish(std::string_view program, int code) {
  if (stdout_error == 0) return code;
  return report_error(program, failed,
                      fmt::format("stdout did not take the whole result ({})", std::strerror(stdout_error)));
}

Progress::Progress(bool quiet, std::string what) : what_(std::move(what)), on_(!quiet && ::isatty(STDERR_FILENO)) {
  if (!what_.empty()) what_ += ' ';
}

Progress::~Progress() {
  if (shown_) report_text("\r\033[K");
}

void Progress::operator()(double share, double seconds_left) {
  const int percent = static_cast<int>(100 * share);
  if (!on_ || percent == last_) return;
  last_ = percent;
  shown_ = true;
  report_text(fmt::format("\r\033[K{}{:3d} %{}", what_, percent,
                          seconds_left >= 0 ? fmt::format(", {:.0f} s left", seconds_left) : ""));
}

}  // namespace tribotwin::twin
