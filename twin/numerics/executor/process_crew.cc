#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <deque>
#include <iostream>
#include <limits>
#include <utility>

#include <fmt/format.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <tribotwin/twin/io/descriptor.hpp>
#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/io/output.hpp>
#include <tribotwin/twin/numerics/executor/crew.hpp>

namespace tribotwin::twin {
namespace {

using Size = std::uint64_t;  ///< of a message, before it

/// Of the process of a task: whether all bytes came, false where the other end has gone.
bool receive_all(int link, char* to, std::size_t size) {
  while (size > 0) {
    const ssize_t got = ::recv(link, to, size, 0);
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return false;
    to += got, size -= static_cast<std::size_t>(got);
  }
  return true;
}

bool send_all(int link, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t sent = ::send(link, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent < 0 && errno == EINTR) continue;
    if (sent <= 0) return false;
    bytes.remove_prefix(static_cast<std::size_t>(sent));
  }
  return true;
}

bool send_message(int link, const std::string& bytes) {
  return send_all(link, BytesOut().put<Size>(bytes.size()).take() + bytes);
}

/// The last lines of what a process wrote, without control characters.
std::string last_lines(std::string text) {
  constexpr std::size_t longest = 600;
  std::erase_if(text, [](char c) { return static_cast<unsigned char>(c) < ' ' && c != '\n'; });
  while (text.ends_with('\n')) text.pop_back();
  if (text.size() > longest) text = "..." + text.substr(text.size() - longest);
  std::ranges::replace(text, '\n', ' ');
  return text;
}

/// How a process ended, in words.
std::string ending(int status) {
  if (!WIFSIGNALED(status)) return fmt::format("its process ended with exit code {}", WEXITSTATUS(status));
  const int signal = WTERMSIG(status);
  return fmt::format("its process was ended by signal {} ({}){}", signal, ::strsignal(signal),
                     signal == SIGKILL ? ", by somebody or for want of memory" : "");
}

class ProcessCrew final : public Crew {
 public:
  ProcessCrew(unsigned processes, Work work, const std::atomic<bool>* stop)
      : work_(std::move(work)), stop_(stop), children_(std::max(1u, processes)) {}

  ~ProcessCrew() override {
    for (Child& child : children_) {
      if (child.pid <= 0) continue;
      (void)::shutdown(child.link, SHUT_RDWR);  // it ends after the task under way
      (void)wait_for(child);
    }
  }

  void add(std::vector<Job> jobs) override {
    for (Job& job : jobs) todo_.push_back(std::move(job));
    hand_out();
  }

  std::vector<Done> take(std::chrono::microseconds at_most) override {
    if (stop_ && *stop_) stop_all();
    hand_out();
    std::vector<pollfd> links;
    for (const Child& child : children_) links.push_back({child.link, POLLIN, 0});  // -1 is ignored
    const auto us = done_.empty() ? at_most.count() : 0;
    const timespec wait{us / 1'000'000, us % 1'000'000 * 1000};
    if (::ppoll(links.data(), links.size(), &wait, nullptr) > 0)
      for (std::size_t i = 0; i < links.size(); ++i)
        if (links[i].revents != 0) read(children_[i]);
    hand_out();
    return std::exchange(done_, {});
  }

  std::size_t waiting() const override { return todo_.size(); }

 private:
  struct Child {
    pid_t pid = 0;
    Descriptor link, messages;  ///< messages: a file in memory that is its stderr
    off_t forwarded = 0;        ///< of the messages
    std::deque<Job> jobs;       ///< the first one is under way
    std::string received;
  };

  /// Short tasks lie ready in their process, which then does not wait for the next one.
  std::size_t ready_jobs() const { return finished_ > 0 && mean_s_ < 0.02 ? 3 : 1; }

  void hand_out() {
    for (std::size_t has = 0; has < ready_jobs(); ++has)
      for (Child& child : children_) {
        constexpr std::size_t short_input = 4096;  // others could fill the socket while the process fills it too
        if (todo_.empty() || child.jobs.size() != has || (has > 0 && todo_.front().input.size() > short_input))
          continue;
        if (child.pid <= 0 && !start(child)) continue;
        const Job& job = child.jobs.emplace_back(std::move(todo_.front()));
        todo_.pop_front();
        // Where its process has gone, `read` finds out.
        (void)send_message(child.link, BytesOut().put<std::uint64_t>(job.task).put(std::string_view(job.input)).take());
      }
    if (todo_.empty() || std::ranges::any_of(children_, [](const Child& child) { return child.pid > 0; })) return;
    done_.push_back(
        {.task = todo_.front().task,
         .result = work_failed(fmt::format("no process can be started for it ({})", std::strerror(errno)))});
    todo_.pop_front();
  }

  bool start(Child& child) {
    std::array<int, 2> ends{};
    if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) return false;
    Descriptor ours(ends[0]), its(ends[1]);
    Descriptor messages(::memfd_create("messages", MFD_CLOEXEC));
    if (messages < 0) return false;
    // What is in a buffer now would be written twice.
    std::cout.flush();
    std::fflush(nullptr);
    const pid_t parent = ::getpid();
    const pid_t pid = ::fork();
    if (pid < 0) return false;
    if (pid == 0) {
      (void)ours.close();
      serve(parent, its, messages);
    }
    child.pid = pid;
    child.link = std::move(ours);
    child.messages = std::move(messages);
    return true;
  }

  /// The process of the tasks, to its end.
  [[noreturn]] void serve(pid_t parent, int link, int messages) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::getppid() != parent) ::_exit(failed);
    obey_parent_only();
    for (Child& other : children_)
      if (other.link >= 0) (void)other.link.close();
    ::dup2(messages, STDOUT_FILENO);
    ::dup2(messages, STDERR_FILENO);
    for (;;) {
      std::array<char, sizeof(Size)> size{};
      if (!receive_all(link, size.data(), size.size())) ::_exit(done);
      std::string bytes(BytesIn({size.data(), size.size()}).get<Size>(), '\0');
      if (!receive_all(link, bytes.data(), bytes.size())) ::_exit(done);
      BytesIn in(bytes);
      Job job{.task = in.get<std::uint64_t>(), .input = {}};
      job.input = in.text();
      BytesOut out;
      put(out, perform(work_, job, stop_));
      std::cout.flush();
      std::fflush(nullptr);
      // With the end of what it wrote: a task that crashes after it writes its own last words behind.
      if (!send_message(link, out.put<std::int64_t>(::lseek(messages, 0, SEEK_END)).take())) ::_exit(failed);
    }
  }

  void read(Child& child) {
    std::array<char, 1 << 16> buffer{};
    for (;;) {
      const ssize_t got = ::recv(child.link, buffer.data(), buffer.size(), MSG_DONTWAIT);
      if (got < 0 && errno == EINTR) continue;
      if (got < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return accept(child);
      if (got <= 0) break;
      child.received.append(buffer.data(), static_cast<std::size_t>(got));
    }
    accept(child);
    bury(child);
  }

  /// The whole messages among the bytes received.
  void accept(Child& child) {
    std::size_t begin = 0;
    const std::string& bytes = child.received;
    for (Size size = 0; begin + sizeof size <= bytes.size(); begin += sizeof size + size) {
      std::memcpy(&size, bytes.data() + begin, sizeof size);
      if (begin + sizeof size + size > bytes.size()) break;
      BytesIn in(std::string_view(bytes).substr(begin + sizeof size, size));
      Done& one = done_.emplace_back(get_done(in));
      one.stopped |= !one.result && stop_ && *stop_;
      mean_s_ += (one.seconds - mean_s_) / static_cast<double>(++finished_);
      child.jobs.pop_front();
      if (const auto text = messages_of(child, in.get<std::int64_t>()); !text.empty()) report_text(text);
    }
    child.received.erase(0, begin);
  }

  /// Its wait status.
  static int wait_for(const Child& child) {
    int status = 0;
    while (::waitpid(child.pid, &status, 0) < 0 && errno == EINTR) {
    }
    return status;
  }

  /// A process that has ended by itself: the task under way has failed, those behind it are for another one.
  void bury(Child& child) {
    const int status = wait_for(child);
    const std::string words = last_lines(messages_of(child));
    if (!child.jobs.empty()) {
      done_.push_back({.task = child.jobs.front().task,
                       .result = work_failed(ending(status) + (words.empty() ? "" : "; its last words: " + words)),
                       .stopped = stop_ && *stop_});
      child.jobs.pop_front();
      todo_.insert(todo_.begin(), std::make_move_iterator(child.jobs.begin()),
                   std::make_move_iterator(child.jobs.end()));
    }
    child = Child();
  }

  /// What it has written since the last call, at most to this place.
  static std::string messages_of(Child& child, off_t end = std::numeric_limits<off_t>::max()) {
    std::string text;
    std::array<char, 4096> buffer{};
    while (child.forwarded < end) {
      const auto size = std::min<off_t>(std::ssize(buffer), end - child.forwarded);
      const ssize_t got = ::pread(child.messages, buffer.data(), static_cast<std::size_t>(size), child.forwarded);
      if (got <= 0) break;
      text.append(buffer.data(), static_cast<std::size_t>(got));
      child.forwarded += got;
    }
    return text;
  }

  /// Nothing begins any more, and what is under way is told.
  void stop_all() {
    for (const Job& job : std::exchange(todo_, {})) done_.push_back({.task = job.task, .result = {}, .stopped = true});
    if (std::exchange(told_to_stop_, true)) return;
    for (const Child& child : children_)
      if (child.pid > 0) ::kill(child.pid, SIGUSR1);
  }

  const Work work_;
  const std::atomic<bool>* const stop_;
  std::vector<Child> children_;
  std::deque<Job> todo_;
  std::vector<Done> done_;
  double mean_s_ = 0;  ///< time of a task
  std::size_t finished_ = 0;
  bool told_to_stop_ = false;
};

}  // namespace

std::unique_ptr<Crew> crew_of_processes(unsigned processes, Crew::Work work, const std::atomic<bool>* stop) {
  return std::make_unique<ProcessCrew>(processes, std::move(work), stop);
}

}  // namespace tribotwin::twin
