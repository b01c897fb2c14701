#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <optional>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <tribotwin/plugins/friction/input_file.hpp>
#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/twin/io/descriptor.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/interrupt.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using Status = Result<void>;

tl::unexpected<Error> not_written(const fs::path& file, int error, ErrorKind kind = ErrorKind::work) {
  return tl::make_unexpected(
      Error(fmt::format("{}: cannot be written ({})", file.string(), std::strerror(error)), kind));
}

/// Of a file that could not be created: the user named it wrongly, or the machine cannot (a disk that is full or has
/// become read-only).
ErrorKind kind_of(int error) {
  constexpr int wrong_name[] = {ENAMETOOLONG, EACCES, EPERM, ENOENT, ENOTDIR, ELOOP};
  return std::ranges::find(wrong_name, error) == std::end(wrong_name) ? ErrorKind::work : ErrorKind::input;
}

tl::unexpected<Error> exists_already(const fs::path& file) {
  return tl::unexpected<Error>(
      fmt::format("{}: exists; choose another name, or replace it with --force", file.string()));
}

std::optional<struct stat> look(const fs::path& file) {
  struct stat s {};
  return ::stat(file.c_str(), &s) == 0 ? std::optional(s) : std::nullopt;
}

bool same(const struct stat& a, const struct stat& b) { return a.st_dev == b.st_dev && a.st_ino == b.st_ino; }

bool is_stream(const struct stat& there) {
  return S_ISFIFO(there.st_mode) || S_ISCHR(there.st_mode) || standard_stream(there);
}

Status check_kind(const fs::path& file, const struct stat& there) {
  const char* kind = S_ISDIR(there.st_mode)    ? "a folder"
                     : S_ISBLK(there.st_mode)  ? "a block device"
                     : S_ISSOCK(there.st_mode) ? "a socket"
                                               : nullptr;
  if (kind) return tl::unexpected(fmt::format("{}: is {}; name a file", file.string(), kind));
  return {};
}

fs::path folder_of(const fs::path& file) { return file.has_parent_path() ? file.parent_path() : fs::path("."); }

Status check_folder(const fs::path& file) {
  const fs::path folder = folder_of(file);
  const auto there = look(folder);
  if (!there) return tl::unexpected(fmt::format("{}: there is no folder {}", file.string(), folder.string()));
  if (!S_ISDIR(there->st_mode))
    return tl::unexpected(fmt::format("{}: {} is no folder", file.string(), folder.string()));
  if (::access(folder.c_str(), W_OK | X_OK) != 0) return not_written(file, errno, ErrorKind::input);
  return {};
}

Status write_stream(const fs::path& file, const struct stat& there, std::string_view bytes) {
  int error = 0;
  if (const auto standard = standard_stream(there)) {
    error = write_all(*standard, bytes);
  } else {
    Descriptor stream;
    if (is_named_pipe(file)) {
      auto pipe = open_for_reader(file);
      if (!pipe) return tl::unexpected(pipe.error());
      stream = std::move(*pipe);
    } else {
      stream = Descriptor(::open(file.c_str(), O_WRONLY | O_CLOEXEC | O_NOCTTY));
    }
    if (stream < 0) return not_written(file, errno);
    error = write_all(stream, bytes);
    if (!stream.close() && error == 0) error = errno;
  }
  if (error != 0) return not_written(file, error);
  return {};
}

/// An unpredictable name beside the file or folder, so that what is created under it is ours.
fs::path partial_of(const fs::path& file) {
  constexpr std::size_t longest_name = 255;
  std::uint64_t random = 0;
  (void)!::getrandom(&random, sizeof random, 0);
  const std::string ending = fmt::format(".partial-{:016x}", random);
  return folder_of(file) / ("." + file.filename().string().substr(0, longest_name - 1 - ending.size()) + ending);
}

/// The target of a link, so that the link itself stays.
fs::path behind_links(const fs::path& file) {
  std::error_code error;
  if (!fs::is_symlink(file, error)) return file;
  const fs::path target = fs::canonical(file, error);
  return error ? file : target;
}

}  // namespace

bool is_same_file(const fs::path& a, const fs::path& b) {
  if (a.empty() || b.empty()) return false;
  const auto there_a = look(a), there_b = look(b);
  if (there_a || there_b) return there_a && there_b && same(*there_a, *there_b) && !S_ISCHR(there_a->st_mode);
  std::error_code error_a, error_b;
  const fs::path place_a = fs::weakly_canonical(fs::absolute(a, error_a), error_a),
                 place_b = fs::weakly_canonical(fs::absolute(b, error_b), error_b);
  return !error_a && !error_b && place_a == place_b;
}

std::optional<int> standard_stream(const struct stat& file) {
  for (const int stream : {STDOUT_FILENO, STDERR_FILENO})
    if (struct stat s{}; ::fstat(stream, &s) == 0 && same(s, file)) return stream;
  return std::nullopt;
}

int rename_to_free_name(const fs::path& from, const fs::path& to) {
  if (::renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE) == 0) return 0;
  if (errno != EINVAL && errno != ENOSYS) return errno;
  // For file systems without this call: a hard link fails where the name is taken.
  if (::link(from.c_str(), to.c_str()) != 0) return errno;
  return ::unlink(from.c_str()) == 0 ? 0 : errno;
}

fs::path free_name(const fs::path& name) {
  std::error_code error;
  fs::path free = name;
  for (int n = 2; fs::symlink_status(free, error).type() != fs::file_type::not_found; ++n)
    free = fmt::format("{}-{}", name.string(), n);
  return free;
}

Status check_output(const fs::path& file, Existing existing, std::span<const fs::path> inputs) {
  if (file.empty()) return tl::unexpected(std::string("the name of an output file is empty"));
  const auto there = look(file);
  if (there && is_stream(*there)) return {};
  for (const fs::path& input : inputs)
    if (is_same_file(file, input))
      return tl::unexpected(fmt::format("{}: is also read or written by this command as {}; choose another name",
                                        file.string(), input.string()));
  if (!there) return check_folder(file);
  if (auto ok = check_kind(file, *there); !ok) return ok;
  if (existing == Existing::refuse) return exists_already(file);
  return check_folder(behind_links(file));
}

Status write_file(const fs::path& file, std::string_view bytes, Existing existing) {
  if (const auto there = look(file); there && is_stream(*there)) return write_stream(file, *there, bytes);
  auto fresh = NewFile::create(file, existing);
  if (!fresh) return tl::unexpected(fresh.error());
  if (auto ok = fresh->write(bytes); !ok) return ok;
  return fresh->publish();
}

Status write_unforced(const fs::path& file, std::string_view bytes) {
  auto fresh = NewFile::create(file, Existing::replace);
  if (!fresh) return tl::unexpected(fresh.error());
  if (auto ok = fresh->write(bytes); !ok) return ok;
  return fresh->publish_unforced();
}

Result<std::string> read_bytes(const fs::path& file) {
  auto bytes = read_input_file(file, "a file of data", limits::file_bytes);
  if (!bytes) bytes.error().kind = ErrorKind::work;
  return bytes;
}

Result<std::vector<fs::directory_entry>> entries_of(const fs::path& folder) {
  std::vector<fs::directory_entry> entries;
  std::error_code error;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) entries.push_back(*at);
  if (error && error != std::errc::no_such_file_or_directory)
    return tl::unexpected(Error(fmt::format("{}: cannot be listed ({})", folder.string(), std::strerror(error.value())),
                                kind_of(error.value())));
  return entries;
}

Status write_derived(const fs::path& file, std::string_view bytes, Existing existing) {
  std::error_code error;
  const bool is_there = fs::exists(file, error);
  if (is_there) {
    const auto old = read_bytes(file);
    if (!old && existing == Existing::refuse) return tl::unexpected(old.error());
    if (old && *old == bytes) return {};
  }
  if (is_there && existing == Existing::refuse)
    return tl::unexpected(
        fmt::format("{}: was changed since it was made; move it away, or replace it with --force", file.string()));
  return write_file(file, bytes, existing);
}

NewFile::NewFile(NewFile&& other) noexcept { *this = std::move(other); }

NewFile& NewFile::operator=(NewFile&& other) noexcept {
  std::swap(file_, other.file_);
  std::swap(partial_, other.partial_);
  std::swap(temporary_, other.temporary_);
  std::swap(existing_, other.existing_);
  std::swap(descriptor_, other.descriptor_);
  return *this;
}

NewFile::~NewFile() {
  if (!partial_.empty()) ::unlink(partial_.c_str());
}

Result<NewFile> NewFile::create(const fs::path& file, Existing existing) {
  const auto there = look(file);
  if (there) {
    if (S_ISDIR(there->st_mode)) return not_written(file, EISDIR, ErrorKind::input);
    if (!S_ISREG(there->st_mode)) return tl::unexpected(fmt::format("{}: must be a regular file", file.string()));
    if (existing == Existing::refuse) return exists_already(file);
  }
  NewFile fresh;
  fresh.file_ = behind_links(file);
  fresh.existing_ = existing;
  const fs::path partial = partial_of(fresh.file_);
  fresh.temporary_ = Temporary(partial);
  fresh.descriptor_ = Descriptor(::open(partial.c_str(), O_CREAT | O_EXCL | O_RDWR | O_NOFOLLOW | O_CLOEXEC, 0666));
  if (fresh.descriptor_ < 0) return not_written(file, errno, kind_of(errno));
  fresh.partial_ = partial;
  if (there && ::fchmod(fresh.descriptor_, there->st_mode & 07777) != 0) return not_written(file, errno);
  return fresh;
}

Status NewFile::write(std::string_view bytes) {
  if (const int error = write_all(descriptor_, bytes); error != 0) return not_written(file_, error);
  return {};
}

Status NewFile::rename_only() {
  const int error = existing_ == Existing::refuse                    ? rename_to_free_name(partial_, file_)
                    : ::rename(partial_.c_str(), file_.c_str()) == 0 ? 0
                                                                     : errno;
  if (error == EEXIST) return exists_already(file_);
  if (error != 0) return not_written(file_, error);
  partial_.clear();
  temporary_ = {};
  return {};
}

Status NewFile::rename_to_final() {
  if (auto ok = rename_only(); !ok) return ok;
  return sync_folder(folder_of(file_));
}

Status NewFile::publish() {
  if (::fsync(descriptor_) != 0 && errno != EINVAL && errno != EROFS) return not_written(file_, errno);
  if (!descriptor_.close()) return not_written(file_, errno);
  return rename_to_final();
}

Status NewFile::publish_growing() { return rename_to_final(); }

Status NewFile::publish_unforced() {
  // Network file systems say here what they could not keep.
  if (!descriptor_.close()) return not_written(file_, errno);
  return rename_only();
}

namespace {

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
  explicit Staging(const fs::path& folder)
      : path_(partial_of(is_there(folder) ? folder / folder.filename() : folder)),
        temporary_(path_),
        error_(::mkdir(path_.c_str(), 0777) == 0 ? 0 : errno) {}
  Staging(const Staging&) = delete;
  Staging& operator=(const Staging&) = delete;
  ~Staging() {
    std::error_code ignored;
    if (error_ == 0) fs::remove_all(path_, ignored);
  }
  const fs::path& path() const { return path_; }
  int error() const { return error_; }

 private:
  const fs::path path_;
  const Temporary temporary_;
  const int error_;
};

/// The message names the file where the user will look for it.
Status as_named(const fs::path& folder, const fs::path& staging, Status made) {
  if (made) return made;
  Error error = made.error();
  if (const auto from = error.message.find(staging.string()); from != std::string::npos)
    error.message.replace(from, staging.string().size(), folder.string());
  return tl::unexpected(error);
}

}  // namespace

std::string name_of_folder(const fs::path& folder) { return without_dots(folder).filename().string(); }

Status check_output_folder(const fs::path& folder, Existing existing) {
  if (folder.empty()) return tl::unexpected<Error>("the name of an output folder is empty");
  const fs::path place = without_dots(folder), parent = place.parent_path();
  std::error_code error;
  if (!is_there(place)) {
    if (!fs::is_directory(parent, error))
      return tl::unexpected<Error>(fmt::format("{}: there is no folder {}", folder.string(), parent.string()));
  } else if (!fs::is_directory(place, error)) {
    return tl::unexpected<Error>(fmt::format("{}: is no folder; choose another name with -o", folder.string()));
  } else if (existing == Existing::refuse && !fs::is_empty(place, error)) {
    return tl::unexpected<Error>(fmt::format(
        "{}: holds files already; choose another folder with -o, or replace them with --force", folder.string()));
  }
  if (::access((is_there(place) ? place : parent).c_str(), W_OK | X_OK) != 0)
    return not_written(folder, errno, ErrorKind::input);
  return {};
}

Status write_folder(const fs::path& folder, std::span<const OutputFile> files, Existing existing) {
  if (auto ok = check_output_folder(folder, existing); !ok) return ok;
  const fs::path place = without_dots(folder);
  for (const OutputFile& file : files)
    if (is_there(place))
      if (auto ok = check_output(place / file.name, Existing::replace); !ok) return ok;
  const Staging staging(place);
  if (staging.error() != 0) return not_written(folder, staging.error());
  for (const OutputFile& file : files)
    if (auto ok = write_file(staging.path() / file.name, file.bytes, Existing::refuse); !ok)
      return as_named(folder, staging.path(), ok);
  if (auto ok = sync_folder(staging.path()); !ok) return as_named(folder, staging.path(), ok);
  if (!is_there(place)) {
    if (::rename(staging.path().c_str(), place.c_str()) != 0) return not_written(folder, errno);
    return sync_folder(place.parent_path());
  }
  for (const OutputFile& file : files)
    if (::rename((staging.path() / file.name).c_str(), (place / file.name).c_str()) != 0)
      return not_written(folder / file.name, errno);
  return sync_folder(place);
}

Status sync_folder(const fs::path& folder) {
  const Descriptor entries(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (entries < 0) return {};  // a folder that may be written but not read
  const int error = ::fsync(entries) == 0 ? 0 : errno;
  if (error == 0 || error == EINVAL || error == EROFS || error == ENOTSUP) return {};
  return work_failed(fmt::format("{}: cannot be forced to disk ({})", folder.string(), std::strerror(error)));
}

TemporaryFolder::TemporaryFolder(std::string_view name) {
  std::error_code error;
  std::string pattern = (fs::temp_directory_path(error) / fmt::format("{}-XXXXXX", name)).string();
  if (error || !::mkdtemp(pattern.data())) return;
  path_ = pattern;
  temporary_ = Temporary(path_);
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  if (!path_.empty()) fs::remove_all(path_, ignored);
}

}  // namespace tribotwin::twin
