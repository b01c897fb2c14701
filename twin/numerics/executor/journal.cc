#include <cerrno>
#include <cstdint>
#include <cstring>
#include <optional>
#include <stdexcept>

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <tribotwin/twin/io/checksum.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/numerics/executor/bytes.hpp>
#include <tribotwin/twin/numerics/executor/journal.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;

/// In front of the first record, which has the identity in place of a task.
constexpr std::string_view first_line = "tribotwin, finished tasks of unfinished work, 1\n";

struct Head {
  std::uint64_t size;  ///< of the task and its result
  std::uint32_t sum;   ///< of the same
};
constexpr std::size_t head_size = sizeof(Head::size) + sizeof(Head::sum);

std::string record_of(std::string_view task, std::string_view result) {
  const std::string body = BytesOut().put(task).put(result).take();
  return BytesOut().put<std::uint64_t>(body.size()).put<std::uint32_t>(crc32(body)).take() + body;
}

/// Cuts the first record off; none where it is not whole.
std::optional<std::pair<std::string, std::string>> next_record(std::string_view& bytes) try {
  if (bytes.size() < head_size) return std::nullopt;
  BytesIn in(bytes);
  const Head head{in.get<std::uint64_t>(), in.get<std::uint32_t>()};
  if (head.size > bytes.size() - head_size) return std::nullopt;
  const std::string_view body = bytes.substr(head_size, head.size);
  if (crc32(body) != head.sum) return std::nullopt;
  BytesIn both(body);
  std::string task = both.text(), result = both.text();
  bytes.remove_prefix(head_size + head.size);
  return std::pair(std::move(task), std::move(result));
} catch (const std::runtime_error&) {  // somebody else's: task and result are longer than the record
  return std::nullopt;
}

tl::unexpected<Error> not_written(const fs::path& file, int error) {
  return work_failed(fmt::format("{}: cannot be written ({})", file.string(), std::strerror(error)));
}

bool begins(std::string_view text, std::string_view with) { return text.substr(0, with.size()) == with; }

}  // namespace

Result<Journal> Journal::open(const fs::path& file, const std::string& identity, std::size_t spare) {
  Journal journal;
  journal.file_ = file, journal.identity_ = identity, journal.spare_ = spare;
  if (auto ok = journal.read(); !ok) return tl::unexpected(ok.error());
  return journal;
}

Result<void> Journal::read() {
  std::error_code error;
  if (!fs::exists(fs::symlink_status(file_, error))) return {};
  const auto refuse = [&](const std::string& why) {
    return tl::unexpected(
        Error(fmt::format("{}: {}; choose another folder with -o, or remove this file", file_.string(), why)));
  };
  if (!fs::is_regular_file(file_, error)) return refuse("is no file");
  const auto all = read_bytes(file_);
  if (!all) return tl::unexpected(all.error());
  std::string_view left = *all;
  if (!begins(left, first_line)) return refuse("is no file of unfinished work");
  left.remove_prefix(first_line.size());
  const auto identity = next_record(left);
  if (!identity) return refuse("is damaged");
  if (identity->first != identity_)
    return refuse("is the unfinished work of another command (its input, its settings or the program differ)");
  there_ = true;
  while (auto one = next_record(left)) {
    live_ += head_size + one->first.size() + one->second.size();
    finished_.insert_or_assign(std::move(one->first), std::move(one->second));
  }
  // What is appended must follow a whole record.
  return left.empty() ? Result<void>() : renew();
}

std::vector<std::pair<std::string_view, std::string_view>> Journal::find(std::string_view beginning) const {
  std::vector<std::pair<std::string_view, std::string_view>> found;
  for (auto at = finished_.lower_bound(beginning); at != finished_.end() && begins(at->first, beginning); ++at)
    found.emplace_back(std::string_view(at->first).substr(beginning.size()), at->second);
  return found;
}

Result<void> Journal::keep(const std::string& task, std::string_view result) {
  if (state_ && !there_) state_ = renew();
  if (!state_) return state_;
  const std::string record = record_of(task, result);
  if (state_ = append(record); !state_) return state_;
  live_ += record.size();
  finished_.insert_or_assign(task, std::string(result));
  return {};
}

Result<void> Journal::append(const std::string& record) {
  if (appended_ < 0) appended_ = Descriptor(::open(file_.c_str(), O_WRONLY | O_APPEND | O_NOFOLLOW | O_CLOEXEC));
  if (appended_ < 0) return not_written(file_, errno);
  if (const int error = write_all(appended_, record); error != 0) return not_written(file_, error);
  const auto now = std::chrono::steady_clock::now();
  if (now - forced_ < std::chrono::seconds(1)) return {};
  forced_ = now;
  if (::fdatasync(appended_) != 0) return not_written(file_, errno);
  return {};
}

Result<void> Journal::forget(std::string_view beginning) {
  const auto first = finished_.lower_bound(beginning);
  auto last = first;
  for (; last != finished_.end() && begins(last->first, beginning); ++last) {
    const std::size_t size = record_of(last->first, last->second).size();
    live_ -= std::min(live_, size), dead_ += size;
  }
  finished_.erase(first, last);
  if (state_ && dead_ > live_ + spare_) state_ = renew();
  return state_;
}

/// The file with nothing but what is needed.
Result<void> Journal::renew() {
  std::string all(first_line);
  all += record_of(identity_, "");
  for (const auto& [task, result] : finished_) all += record_of(task, result);
  if (auto ok = write_file(file_, all, Existing::replace); !ok) return work_failed(ok.error().message);
  appended_ = Descriptor();
  there_ = true, live_ = all.size(), dead_ = 0;
  return {};
}

void Journal::remove() {
  appended_ = Descriptor();
  finished_.clear();
  std::error_code ignored;
  if (there_) fs::remove(file_, ignored);
  there_ = false, live_ = dead_ = 0;
}

}  // namespace tribotwin::twin
