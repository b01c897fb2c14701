#include <array>
#include <cerrno>
#include <climits>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string_view>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/magic.h>
#include <poll.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/io/output.hpp>

namespace tribotwin::twin {
namespace {

std::atomic<bool> flag{false}, caught{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler writes it");
constexpr std::array endings{SIGINT, SIGTERM, SIGHUP};

/// Names where a signal handler finds them. `owner`: the process whose name it is; 0: nobody's.
struct Slot {
  std::atomic<pid_t> owner{0};
  char name[PATH_MAX];
};
constexpr pid_t being_written = -1;
std::array<Slot, 256> temporaries;
static_assert(std::atomic<pid_t>::is_always_lock_free, "a signal handler reads it");

/// A file, or a folder with all that is in it; only by calls that a signal handler may make.
void remove_all(int folder, const char* name) {
  if (::unlinkat(folder, name, 0) == 0 || errno != EISDIR) return;
  const int fd = ::openat(folder, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
  if (fd < 0) return;
  constexpr std::size_t name_at = 19, length_at = 16;  // in linux_dirent64
  alignas(std::uint64_t) char entries[2048];
  for (long got; (got = ::syscall(SYS_getdents64, fd, entries, sizeof entries)) > 0;)
    for (long at = 0; at < got;) {
      const char* const entry = entries + at;
      const std::string_view found = entry + name_at;
      if (found != "." && found != "..") remove_all(fd, found.data());
      std::uint16_t length = 0;
      std::memcpy(&length, entry + length_at, sizeof length);
      at += length;
    }
  ::close(fd);
  ::unlinkat(folder, name, AT_REMOVEDIR);
}

/// Ends the program by the signal, as if nothing had caught it: when this handler returns, it arrives.
void end_by(int signal) {
  const int error = errno;
  remove_temporaries();
  ::signal(signal, SIG_DFL);
  ::raise(signal);
  errno = error;
}

void handle(int signal, void (*handler)(int)) {
  struct sigaction action {};
  action.sa_handler = handler;  // without SA_RESTART
  ::sigaction(signal, &action, nullptr);
}

bool is_ignored(int signal) {  // SIGHUP by nohup; SIGINT by a shell without job control, for what it runs with &
  struct sigaction now {};
  return ::sigaction(signal, nullptr, &now) == 0 && now.sa_handler == SIG_IGN;
}

}  // namespace

Temporary::Temporary(const std::filesystem::path& name) {
  const std::string& text = name.native();
  if (text.size() >= PATH_MAX) return;
  for (std::size_t i = 0; i < temporaries.size(); ++i) {
    pid_t nobody = 0;
    if (!temporaries[i].owner.compare_exchange_strong(nobody, being_written)) continue;
    text.copy(temporaries[i].name, text.size());
    temporaries[i].name[text.size()] = 0;
    temporaries[i].owner = ::getpid();
    slot_ = static_cast<int>(i);
    return;
  }
}

Temporary::Temporary(Temporary&& other) noexcept : slot_(std::exchange(other.slot_, -1)) {}

Temporary& Temporary::operator=(Temporary&& other) noexcept {
  std::swap(slot_, other.slot_);
  return *this;
}

Temporary::~Temporary() {
  if (slot_ >= 0) temporaries[static_cast<std::size_t>(slot_)].owner = 0;
}

void remove_temporaries() {
  const pid_t self = ::getpid();
  for (const Slot& slot : temporaries)
    if (slot.owner == self) remove_all(AT_FDCWD, slot.name);
}

void remove_temporaries_at_end() {
  for (const int signal : endings)
    if (!is_ignored(signal)) handle(signal, end_by);
  std::at_quick_exit(remove_temporaries);
}

void catch_interrupts() {
  caught = false;
  for (const int signal : endings)
    if (!is_ignored(signal))
      handle(signal, [](int arrived) {
        if (caught.exchange(true)) return end_by(arrived);
        flag = true;
      });
}

void obey_parent_only() {
  handle(SIGUSR1, [](int) { flag = true; });
  handle(SIGTERM, end_by);
  for (const int signal : {SIGINT, SIGHUP}) handle(signal, SIG_IGN);
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
