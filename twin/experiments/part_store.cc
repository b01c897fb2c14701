#include <cerrno>
#include <cstring>
#include <sstream>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <tribotwin/twin/experiments/part_store.hpp>
#include <tribotwin/twin/io/checksum.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;

std::string sum_of(std::string_view text) { return fmt::format("{:08x}", crc32(text)); }

tl::unexpected<Error> not_written(const fs::path& file, int error) {
  return work_failed(fmt::format("{}: cannot be written ({})", file.string(), std::strerror(error)));
}

}  // namespace

Result<PartStore> PartStore::open(const fs::path& directory, const std::string& folder) {
  PartStore store;
  store.folder_ = directory / folder;
  store.file_ = directory / "checksums";
  if (std::error_code error; fs::exists(store.file_, error)) {
    auto lines = read_bytes(store.file_);
    if (!lines) return tl::unexpected(lines.error());
    store.lines_ = *std::move(lines);
  }
  // A kill may have cut the last line; what is appended begins a new one.
  const std::string whole = store.lines_.substr(0, store.lines_.rfind('\n') + 1);
  std::istringstream lines(whole);
  for (std::string line; std::getline(lines, line);)
    if (const auto blank = line.find(' '); blank != line.npos)
      store.sums_[line.substr(blank + 1)] = line.substr(0, blank);
  if (whole == store.lines_) return store;
  store.lines_ = whole;
  if (auto ok = write_file(store.file_, whole, Existing::replace); !ok) return tl::unexpected(ok.error());
  return store;
}

std::optional<std::string> PartStore::find(const std::string& name) const {
  const auto sum = sums_.find(name);
  if (sum == sums_.end()) return std::nullopt;
  auto text = read_text(folder_ / name, "a file");
  if (!text || sum->second != sum_of(*text)) return std::nullopt;
  return std::move(*text);
}

Result<void> PartStore::keep(const std::string& name, std::string_view text) {
  if (auto ok = write_unforced(folder_ / name, text); !ok) return ok;
  if (appended_ < 0) {
    appended_ = Descriptor(::open(file_.c_str(), O_CREAT | O_WRONLY | O_APPEND | O_NOFOLLOW | O_CLOEXEC, 0666));
    if (appended_ < 0) return not_written(file_, errno);
  }
  const std::string line = fmt::format("{} {}\n", sums_[name] = sum_of(text), name);
  if (const int error = write_all(appended_, line); error != 0) return not_written(file_, error);
  lines_ += line;
  return std::chrono::steady_clock::now() - forced_ > std::chrono::seconds(1) ? force() : Result<void>();
}

Result<void> PartStore::force() {
  if (appended_ >= 0 && ::fdatasync(appended_) != 0) return not_written(file_, errno);
  if (appended_ >= 0 && ::syncfs(appended_) != 0) return not_written(folder_, errno);
  forced_ = std::chrono::steady_clock::now();
  return {};
}

Result<void> PartStore::finish() {
  if (auto ok = force(); !ok) return ok;
  if (appended_ >= 0 && !appended_.close()) return not_written(file_, errno);
  std::string all;
  for (const auto& [name, sum] : sums_) all += fmt::format("{} {}\n", sum, name);
  if (all == lines_) return {};
  lines_ = all;
  return write_file(file_, all, Existing::replace);
}

}  // namespace tribotwin::twin
