#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <new>
#include <utility>

#include <fcntl.h>
#include <unistd.h>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/descriptor.hpp>
#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/io/output.hpp>

namespace tribotwin::twin {
namespace {

int stdout_error = 0;  // errno of the first write to stdout that failed
bool colour_of_stream[] = {false, false};
bool held_back = false;
std::string last_error;                                // while held back
bool progress_shown = false;                           // the cursor stands behind the line of a Progress
std::chrono::steady_clock::time_point progress_begun;  // of the latest; one job at a time shows any

/// The first steps of a job say little about the others: until then no time left is shown.
constexpr std::chrono::seconds settled_after{3};

constexpr std::string_view red = "\033[1;31m", yellow = "\033[1;33m", cyan = "\033[1;36m", thick = "\033[1m",
                           plain = "\033[0m";

/// `text` with its beginning of `length` in a colour, where messages are coloured.
std::string message(std::string_view text, std::size_t length, std::string_view colour) {
  if (!coloured(Stream::messages)) return std::string(text);
  return fmt::format("{}{}{}{}", colour, text.substr(0, length), plain, text.substr(length));
}

/// Without control characters but those of bold(), where the output is coloured.
std::string with_own_styles(std::string_view text) {
  std::string out;
  while (coloured(Stream::output) && !text.empty()) {
    const auto begin = std::min(text.find(thick), text.find(plain));
    out += without_controls(std::string(text.substr(0, begin)));
    if (begin == text.npos) return out;
    const std::string_view ours = text.substr(begin).starts_with(thick) ? thick : plain;
    out += ours;
    text.remove_prefix(begin + ours.size());
  }
  return out + without_controls(std::string(text));
}

/// What comes next begins a line of its own.
void erase_progress() {
  if (std::exchange(progress_shown, false)) (void)write_all(STDERR_FILENO, "\r\033[K");
}

/// An exception that nothing caught. Takes no memory: there may be none.
[[noreturn]] void give_up() {
  bool no_memory = false;
  std::string_view why = "an error of the program itself, which it does not handle";
  try {
    if (const auto error = std::current_exception()) std::rethrow_exception(error);
  } catch (const std::bad_alloc&) {
    no_memory = true;
    why = "out of memory";
  } catch (...) {
  }
  for (const std::string_view text :
       {std::string_view(program_invocation_short_name), std::string_view(": "), why, std::string_view("\n")})
    (void)write_all(STDERR_FILENO, text);
  remove_temporaries();
  if (!no_memory) std::abort();  // with what a debugger can read
  std::_Exit(failed);
}

}  // namespace

void prepare_streams() {
  std::set_terminate(give_up);
  remove_temporaries_at_end();
  for (const int signal : {SIGPIPE, SIGXFSZ}) std::signal(signal, SIG_IGN);
  std::signal(SIGCHLD, SIG_DFL);
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    if (::fcntl(stream, F_GETFD) < 0) (void)::open("/dev/null", stream == STDIN_FILENO ? O_WRONLY : O_RDONLY);
}

void hold_output_back() { held_back = true; }
const std::string& held_error() { return last_error; }

void print_text(std::string_view text) {
  if (held_back) return;
  erase_progress();
  if (stdout_error == 0) stdout_error = write_all(STDOUT_FILENO, with_own_styles(text));
}

std::string bold(std::string_view text, Stream stream) {
  return coloured(stream) ? fmt::format("{}{}{}", thick, text, plain) : std::string(text);
}

void choose_colour(int argc, const char* const* argv) {
  std::string_view when = "auto";
  for (int i = 1; i < argc; ++i) {
    const std::string_view argument = argv[i];
    if (argument == "--") break;
    for (const std::string_view name : {"--color", "--colour"}) {
      if (argument == name && i + 1 < argc) when = argv[i + 1];
      if (argument.starts_with(name) && argument.substr(name.size()).starts_with('='))
        when = argument.substr(name.size() + 1);
    }
  }
  const char *none = std::getenv("NO_COLOR"), *terminal = std::getenv("TERM");
  const bool wanted = !(none && *none) && terminal && std::string_view(terminal) != "dumb";
  const int streams[] = {STDOUT_FILENO, STDERR_FILENO};
  for (int i = 0; i < 2; ++i)
    colour_of_stream[i] = when == "always" || (when == "auto" && wanted && ::isatty(streams[i]));
}

bool coloured(Stream stream) { return colour_of_stream[stream == Stream::messages]; }

void report_text(std::string_view text) {
  if (held_back) return;
  erase_progress();
  for (const auto& [word, colour] :
       {std::pair<std::string_view, std::string_view>{"note:", cyan}, {"warning:", yellow}})
    if (text.starts_with(word)) {
      (void)write_all(STDERR_FILENO, message(without_controls(std::string(text)), word.size(), colour));
      return;
    }
  (void)write_all(STDERR_FILENO, text);
}

int report_error(std::string_view program, Exit code, std::string_view given) {
  const std::string text = without_controls(std::string(given));
  if (held_back) last_error = text;
  report_text(message(fmt::format("{}: {}\n", program, text), program.size() + 1, red));
  return code;
}

int finish(std::string_view program, int code) {
  if (stdout_error == 0) return code;
  return report_error(program, failed,
                      fmt::format("stdout did not take the whole result ({})", std::strerror(stdout_error)));
}

Progress::Progress(bool quiet, std::string what)
    : what_(std::move(what)), on_(!quiet && !held_back && ::isatty(STDERR_FILENO)) {
  if (!what_.empty()) what_ += ' ';
  progress_begun = std::chrono::steady_clock::now();
}

Progress::~Progress() {
  if (shown_) erase_progress();
}

void Progress::operator()(double share, double seconds_left) {
  const int percent = static_cast<int>(100 * share);
  if (!on_ || percent == last_) return;
  last_ = percent;
  const bool known = seconds_left >= 0 && std::chrono::steady_clock::now() - progress_begun >= settled_after;
  (void)write_all(STDERR_FILENO, fmt::format("\r\033[K{}{:3d} %{}", what_, percent,
                                             known ? fmt::format(", {:.0f} s left", seconds_left) : ""));
  shown_ = progress_shown = true;
}

}  // namespace tribotwin::twin
