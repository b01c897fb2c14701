#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <string_view>
#include <system_error>
#include <utility>

#include <fmt/format.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <tribotwin/hil/commands/output_folder.hpp>
#include <tribotwin/twin/io/interrupt.hpp>

namespace tribotwin::hil {
namespace {

namespace fs = std::filesystem;
using Status = Result<void>;

tl::unexpected<Error> not_written(const fs::path& file, int error) {
  return work_failed(fmt::format("{}: cannot be written ({})", file.string(), std::strerror(error)));
}

/// Also of "runs/", "." and "..".
fs::path without_dots(const fs::path& folder) {
  std::error_code error;
  fs::path place = fs::absolute(folder, error).lexically_normal();
  return place.has_filename() ? place : place.parent_path();
}

bool is_there(const fs::path& folder) {
  std::error_code error;
  return fs::exists(folder, error);
}

/// A hidden folder in which the files are made; removed with all that is still in it. It is beside the folder that it
/// will become, or in the one that exists, which may be a disk of its own.
class Staging {
 public:
  explicit Staging(const fs::path& folder) {
    std::uint64_t random = 0;
    (void)!::getrandom(&random, sizeof random, 0);
    path_ = (is_there(folder) ? folder : folder.parent_path()) /
            fmt::format(".{}.partial-{:016x}", folder.filename().string(), random);
    temporary_ = twin::Temporary(path_);
    error_ = ::mkdir(path_.c_str(), 0777) == 0 ? 0 : errno;
  }
  Staging(const Staging&) = delete;
  Staging& operator=(const Staging&) = delete;
  ~Staging() {
    std::error_code ignored;
    if (error_ == 0) fs::remove_all(path_, ignored);
  }
  const fs::path& path() const { return path_; }
  int error() const { return error_; }

 private:
  fs::path path_;
  twin::Temporary temporary_;
  int error_;
};

/// The message names the file where the user will look for it.
Status at(const fs::path& folder, const fs::path& staging, Status made) {
  if (made) return made;
  Error error = made.error();
  if (const auto from = error.message.find(staging.string()); from != std::string::npos)
    error.message.replace(from, staging.string().size(), folder.string());
  return tl::unexpected(error);
}

}  // namespace

std::string name_of_folder(const fs::path& folder) { return without_dots(folder).filename().string(); }

Status check_output_folder(const fs::path& folder, twin::Existing existing) {
  if (folder.empty()) return tl::unexpected<Error>("the name of an output folder is empty");
  const fs::path place = without_dots(folder), parent = place.parent_path();
  std::error_code error;
  if (!is_there(place)) {
    if (!fs::is_directory(parent, error))
      return tl::unexpected<Error>(fmt::format("{}: there is no folder {}", folder.string(), parent.string()));
  } else if (!fs::is_directory(place, error)) {
    return tl::unexpected<Error>(fmt::format("{}: is no folder; name a folder with -o", folder.string()));
  } else if (existing == twin::Existing::refuse && !fs::is_empty(place, error)) {
    return tl::unexpected<Error>(fmt::format(
        "{}: holds files already; choose another folder with -o, or replace them with --force", folder.string()));
  }
  if (::access((is_there(place) ? place : parent).c_str(), W_OK | X_OK) != 0)
    return tl::unexpected<Error>(fmt::format("{}: cannot be written ({})", folder.string(), std::strerror(errno)));
  return {};
}

Status write_folder(const fs::path& folder, std::span<const OutputFile> files, twin::Existing existing) {
  if (auto ok = check_output_folder(folder, existing); !ok) return ok;
  const fs::path place = without_dots(folder);
  for (const OutputFile& file : files)
    if (is_there(place))
      if (auto ok = twin::check_output(place / file.name, twin::Existing::replace); !ok) return ok;
  const Staging staging(place);
  if (staging.error() != 0) return not_written(folder, staging.error());
  for (const OutputFile& file : files)
    if (auto ok = twin::write_file(staging.path() / file.name, file.bytes, twin::Existing::refuse); !ok)
      return at(folder, staging.path(), ok);
  if (auto ok = twin::sync_folder(staging.path()); !ok) return at(folder, staging.path(), ok);
  if (!is_there(place)) {
    if (::rename(staging.path().c_str(), place.c_str()) != 0) return not_written(folder, errno);
    return twin::sync_folder(place.parent_path());
  }
  for (const OutputFile& file : files)
    if (::rename((staging.path() / file.name).c_str(), (place / file.name).c_str()) != 0)
      return not_written(folder / file.name, errno);
  return twin::sync_folder(place);
}

}  // namespace tribotwin::hil
