#include <cerrno>
#include <cstring>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/stat.h>

#include <tribotwin/hil/can/clock.hpp>
#include <tribotwin/hil/can/record_file.hpp>
#include <tribotwin/twin/io/file.hpp>

namespace tribotwin::hil {
namespace {

using twin::Descriptor;

using Status = Result<void>;

constexpr std::size_t max_waiting = 64 * 1024;
constexpr std::int64_t flush_interval_ns = 250'000'000;
constexpr int pipe_wait_ms = 100;

std::string not_written(const std::filesystem::path& file, std::string_view why) {
  return fmt::format("{}: cannot be written ({})", file.string(), why);
}

std::string reason(int error) {
  if (error == EAGAIN) return "the reader of this pipe is too slow";
  if (error == ENXIO) return "this pipe has no reader";
  return std::strerror(error);
}

}  // namespace

RecordFile::RecordFile(std::filesystem::path file, RecordOptions options, Descriptor fd, bool created)
    : file_(std::move(file)),
      options_(std::move(options)),
      fd_(std::move(fd)),
      created_(created),
      flushed_ns_(clock_ns()) {}

Result<RecordFile> RecordFile::create(const std::filesystem::path& file, RecordOptions options) {
  constexpr int flags =
      O_WRONLY | O_CLOEXEC | O_NONBLOCK;  // O_NONBLOCK: a pipe without reader must not hold the drives
  Descriptor fd(::open(file.c_str(), flags | O_CREAT | O_EXCL, 0666));
  const bool created = fd.get() >= 0;
  if (!created && errno == EEXIST) fd = Descriptor(::open(file.c_str(), flags));
  if (fd.get() < 0) return work_failed(not_written(file, reason(errno)));
  RecordFile record(file, std::move(options), std::move(fd), created);
  struct stat found {};
  if (::fstat(record.fd_.get(), &found) != 0) return work_failed(not_written(file, reason(errno)));
  if (const auto stream = twin::standard_stream(found)) {
    record.fd_ = Descriptor(::fcntl(*stream, F_DUPFD_CLOEXEC, 0));
    return record;
  }
  record.regular_ = S_ISREG(found.st_mode);
  if (!record.regular_) return record;
  // The second session is refused, even if both found no file, an empty one, or one to replace.
  if (::flock(record.fd_.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
    return tl::unexpected(fmt::format("{}: another session is writing it; give another name", file.string()));
  if (::fstat(record.fd_.get(), &found) == 0 && found.st_size > 0 && !record.options_.replace)
    return tl::unexpected(
        fmt::format("{}: exists already; give another name, or --force to replace it", file.string()));
  return record;
}

RecordFile::~RecordFile() {
  if (fd_.get() < 0) return;
  (void)flush();
  if (created_ && !written_) ::unlink(file_.c_str());
}

Status RecordFile::fail(int error) {
  error_ = not_written(file_, reason(error));
  if (!replaced_.empty()) error_ += fmt::format("; what it was to replace is kept in {}", replaced_.string());
  if (regular_) (void)!::ftruncate(fd_.get(), size_);  // drop the incomplete line
  waiting_.clear();
  return work_failed(error_);
}

Status RecordFile::append(std::string_view lines) {
  if (!error_.empty()) return work_failed(error_);
  waiting_ += lines;
  return waiting_.size() >= max_waiting || clock_ns() - flushed_ns_ >= flush_interval_ns ? flush() : Status{};
}

Status RecordFile::begin() {
  struct stat found {};
  const bool first = !std::exchange(written_, true);
  return first && regular_ && ::fstat(fd_.get(), &found) == 0 && found.st_size > 0 ? set_aside() : Status{};
}

Status RecordFile::set_aside() {
  std::error_code error;
  const std::filesystem::path file = std::filesystem::canonical(file_, error);
  if (error) return fail(error.value());
  // Older ones may be there, of sessions that were killed; another may appear at any time.
  std::filesystem::path aside;
  int taken = EEXIST;
  while (taken == EEXIST) {
    aside = twin::free_name(file.string() + ".replaced");
    taken = twin::rename_to_free_name(file, aside);
  }
  if (taken != 0) {
    error_ = not_written(aside, reason(taken));
    waiting_.clear();
    return work_failed(error_);
  }
  replaced_ = aside;
  fd_ = Descriptor(::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
  if (fd_.get() < 0) return fail(errno);
  (void)::flock(fd_.get(), LOCK_EX | LOCK_NB);  // no other process can have this new file open
  return {};
}

Status RecordFile::flush() {
  if (!error_.empty()) return work_failed(error_);
  flushed_ns_ = clock_ns();
  if (waiting_.empty()) return {};
  if (auto ok = begin(); !ok) return ok;
  std::size_t sent = 0;
  while (sent < waiting_.size()) {
    const ssize_t n = ::write(fd_.get(), waiting_.data() + sent, waiting_.size() - sent);
    const int error = n < 0 ? errno : 0;
    if (n >= 0)
      sent += static_cast<std::size_t>(n);
    else if (error != EINTR && (error != EAGAIN || !reader_takes_more())) {
      size_ += static_cast<std::int64_t>(std::string_view(waiting_).substr(0, sent).rfind('\n') + 1);  // npos + 1 is 0
      return fail(error);
    }
  }
  size_ += static_cast<std::int64_t>(sent);
  waiting_.clear();
  return {};
}

/// Waits for the reader of a full pipe; false where the session gives up.
bool RecordFile::reader_takes_more() {
  pollfd pipe{fd_.get(), POLLOUT, 0};
  return ::poll(&pipe, 1, pipe_wait_ms) != 0 || (options_.give_up && !options_.give_up());
}

/// Forces the file's name to disk.
Status RecordFile::sync_name() {
  std::error_code error;
  const std::filesystem::path file = std::filesystem::canonical(file_, error);
  if (error) return {};  // somebody has removed it
  if (auto ok = twin::sync_folder(file.parent_path()); !ok)
    return work_failed(fmt::format("{}: {}", file_.string(), ok.error().message));
  return {};
}

Status RecordFile::finish() {
  if (auto ok = flush(); !ok) return ok;
  if (auto ok = begin(); !ok) return ok;
  if (regular_ && ::fsync(fd_.get()) != 0) return fail(errno);
  error_ = fd_.close() ? "" : not_written(file_, reason(errno));
  if (error_.empty() && regular_)
    if (auto ok = sync_name(); !ok) error_ = ok.error().message;
  if (!error_.empty()) return work_failed(error_);
  if (!replaced_.empty()) ::unlink(replaced_.c_str());
  return {};
}

}  // namespace tribotwin::hil
