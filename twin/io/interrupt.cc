#include <cerrno>
#include <csignal>
#include <cstring>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/magic.h>
#include <poll.h>
#include <sys/stat.h>
#include <sys/vfs.h>

#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/io/output.hpp>

namespace tribotwin::twin {
namespace {

std::atomic<bool> flag{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler writes it");

}  // namespace

void catch_interrupts() {
  struct sigaction action {};
  action.sa_handler = [](int) { flag = true; };
  action.sa_flags = static_cast<int>(SA_RESETHAND);  // and not SA_RESTART
  struct sigaction before {};
  for (const int signal : {SIGINT, SIGTERM, SIGHUP})
    if (signal != SIGHUP || (::sigaction(signal, nullptr, &before) == 0 && before.sa_handler != SIG_IGN))  // nohup
      ::sigaction(signal, &action, nullptr);
}

void obey_parent_only() {
  struct sigaction action {};
  action.sa_handler = [](int) { flag = true; };
  ::sigaction(SIGUSR1, &action, nullptr);
  action.sa_handler = SIG_DFL;
  ::sigaction(SIGTERM, &action, nullptr);
  action.sa_handler = SIG_IGN;
  for (const int signal : {SIGINT, SIGHUP}) ::sigaction(signal, &action, nullptr);
}

std::atomic<bool>& interrupted() { return flag; }

namespace {

constexpr int ask_again_ms = 100, soon_ms = 500;

/// Says once that the program waits; the other end may be there in a moment.
class Wait {
 public:
  Wait(const std::filesystem::path& pipe, const char* whom) : pipe_(pipe), whom_(whom) {}
  /// False where a signal has ended the wait.
  bool goes_on() {
    waited_ms_ += ask_again_ms;
    if (waited_ms_ >= soon_ms && !std::exchange(said_, true))
      note("{}: is a pipe; waiting for a {}", pipe_.string(), whom_);
    return !interrupted();
  }

 private:
  const std::filesystem::path& pipe_;
  const char* whom_;
  int waited_ms_ = 0;
  bool said_ = false;
};

tl::unexpected<Error> failure(const std::filesystem::path& pipe, const char* what, int error) {
  return work_failed(fmt::format("{}: {} ({})", pipe.string(), what, std::strerror(error)));
}

}  // namespace

bool is_named_pipe(const std::filesystem::path& file) {
  struct stat found {};
  struct statfs place {};
  return ::stat(file.c_str(), &found) == 0 && S_ISFIFO(found.st_mode) && ::statfs(file.c_str(), &place) == 0 &&
         place.f_type != PIPEFS_MAGIC;
}

Result<Descriptor> open_for_reader(const std::filesystem::path& pipe) {
  Wait wait(pipe, "reader");
  for (;;) {
    Descriptor end(::open(pipe.c_str(), O_WRONLY | O_CLOEXEC | O_NOCTTY | O_NONBLOCK));
    if (end >= 0) {
      if (::fcntl(end, F_SETFL, ::fcntl(end, F_GETFL) & ~O_NONBLOCK) < 0)
        return failure(pipe, "cannot be written", errno);
      return end;
    }
    if (errno != ENXIO) return failure(pipe, "cannot be written", errno);
    if (!wait.goes_on()) return work_failed(fmt::format("{}: interrupted; the pipe had no reader", pipe.string()));
    (void)::poll(nullptr, 0, ask_again_ms);
  }
}

Result<std::ifstream> open_from_writer(const std::filesystem::path& pipe) {
  // Both ends: so neither this nor the opening of the stream waits, and what a writer has sent stays when it has gone.
  const Descriptor both(::open(pipe.c_str(), O_RDWR | O_CLOEXEC | O_NONBLOCK));
  if (both < 0) return failure(pipe, "cannot be read", errno);
  Wait wait(pipe, "writer");
  for (pollfd input{both, POLLIN, 0}; ::poll(&input, 1, ask_again_ms) <= 0;)
    if (!wait.goes_on()) return work_failed(fmt::format("{}: interrupted; the pipe had no writer", pipe.string()));
  std::ifstream stream(pipe, std::ios::binary);
  if (!stream) return failure(pipe, "cannot be read", errno);
  return stream;
}

}  // namespace tribotwin::twin
