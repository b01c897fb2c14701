#include <cerrno>
#include <cstring>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/live/live_file.hpp>

namespace tribotwin::twin::live {

namespace fs = std::filesystem;

namespace {

bool is_there(const fs::path& file) {
  std::error_code error;
  return fs::symlink_status(file, error).type() != fs::file_type::not_found;
}

void replace_all(std::string& text, const std::string& what, const std::string& by) {
  for (auto at = text.find(what); at != text.npos && !what.empty(); at = text.find(what, at + by.size()))
    text.replace(at, what.size(), by);
}

}  // namespace

LiveFile::LiveFile(fs::path folder, double time_s, std::string extension)
    : folder_(std::move(folder)), stem_(fmt::format("live-{:06.1f}s", time_s)), extension_(std::move(extension)) {}

std::string LiveFile::numbered(int n) const {
  return n == 1 ? fmt::format("{}.{}", stem_, extension_) : fmt::format("{}-{}.{}", stem_, n, extension_);
}

Result<LiveFile> LiveFile::create(const fs::path& folder, double time_s, std::string extension,
                                  const std::string& reserved) {
  LiveFile one(folder, time_s, std::move(extension));
  for (int n = 1; one.name_.empty() || one.name_ == reserved || is_there(folder / one.name_); ++n)
    one.name_ = one.numbered(n);
  auto file = NewFile::create(folder / one.name_, Existing::refuse);
  if (!file) return tl::unexpected(one.without_path(file.error()));
  one.file_ = *std::move(file);
  return one;
}

Result<void> LiveFile::write(std::string_view bytes) {
  return file_->write(bytes).map_error([this](Error error) { return without_path(std::move(error)); });
}

Result<void> LiveFile::publish() {
  auto published = file_->publish();
  // Who else took the name while it was written; the data are on disk.
  for (int n = 1; !published && is_there(folder_ / name_) && is_there(file_->partial()); ++n) {
    name_ = numbered(n);
    const int error = rename_to_free_name(file_->partial(), folder_ / name_);
    if (error == 0) published = sync_folder(folder_);
    if (error != 0 && error != EEXIST) break;
  }
  return published.map_error([this](Error error) { return without_path(std::move(error)); });
}

Error LiveFile::without_path(Error error) const {
  if (file_) replace_all(error.message, file_->partial().filename().string(), name_);
  replace_all(error.message, (folder_ / "").string(), "");
  return error;
}

}  // namespace tribotwin::twin::live
