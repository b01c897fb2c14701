#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/descriptor.hpp>
#include <tribotwin/twin/io/interrupt.hpp>

struct stat;

/// All files are created here: the new content is written beside the old file under an unpredictable name, forced to
/// disk and renamed. After a crash, a kill or a full disk the file is the old one or the whole new one. Devices and
/// FIFOs stay what they are: they are written as streams. All messages name the file and the reason.
namespace tribotwin::twin {

/// What happens to a file of that name.
enum class Existing { refuse, replace };

constexpr Existing replace_if(bool force) { return force ? Existing::replace : Existing::refuse; }

/// Whether `file` may become an output: for the start of a command, before its work. Refuses a folder, a name in a
/// folder that does not exist, what exists (unless it may be replaced) and, always, one of `inputs`, also under another
/// name; these are the other files that the command reads or writes.
Result<void> check_output(const std::filesystem::path& file, Existing existing,
                          std::span<const std::filesystem::path> inputs = {});

Result<void> write_file(const std::filesystem::path& file, std::string_view bytes, Existing existing);

/// Replaces the file by the whole new one, but does not force it to disk: a kill leaves the old file or the new one, a
/// machine that loses power perhaps neither. For files that are checked when they are read.
Result<void> write_unforced(const std::filesystem::path& file, std::string_view bytes);

/// Writes a file derived from other files. An identical file is left alone; a different one counts as an existing file.
Result<void> write_derived(const std::filesystem::path& file, std::string_view bytes, Existing existing);

/// A result that is several files in one folder, for a command that makes all of them at once (a run that grows has
/// RunFolder): a file's name there and its content.
struct OutputFile {
  std::string name, bytes;
};

/// Its last name, also of "runs/" and ".".
std::string name_of_folder(const std::filesystem::path& folder);

/// Whether `folder` may become an output: for the start of a command, before its work. Refuses what is no folder, a
/// name in a folder that does not exist, and a folder that holds anything (unless it may be replaced).
Result<void> check_output_folder(const std::filesystem::path& folder, Existing existing);

/// Writes the files under a hidden name, forces them to disk and moves them into place. A folder that did not exist is
/// there with all files or not at all. In one that exists (--force) each file is the old or the new one, and
/// files of other names stay.
Result<void> write_folder(const std::filesystem::path& folder, std::span<const OutputFile> files, Existing existing);

/// A regular file that is not yet published, for content that comes in pieces or from a library that needs a file name.
class NewFile {
 public:
  /// Creates an empty file beside `file`, with the permissions that `file` has or will have. Fails with
  /// ErrorKind::input where the name is wrong (a folder, no permission, too long), with ErrorKind::work where the
  /// machine cannot.
  static Result<NewFile> create(const std::filesystem::path& file, Existing existing);
  NewFile(NewFile&& other) noexcept;
  NewFile& operator=(NewFile&& other) noexcept;
  ~NewFile();  ///< without publish(): nothing is left; nor after a signal that ends the program

  /// Its name until it is published: ".NAME.partial-XXXXXXXX" in the same folder.
  const std::filesystem::path& partial() const { return partial_; }
  /// For another program that writes the file: also when its name is gone, it makes no file of that name again.
  int descriptor() const { return descriptor_; }
  Result<void> write(std::string_view bytes);
  /// Forces the data to disk and renames the file to its name. Never replaces a file that must stay.
  Result<void> publish();
  /// Renames the file to its name while writing continues: a record that others read while it grows. Data are not
  /// forced to disk.
  Result<void> publish_growing();
  /// Renames the file to its name; neither data nor name are forced to disk.
  Result<void> publish_unforced();

 private:
  NewFile() = default;
  Result<void> rename_only();
  Result<void> rename_to_final();

  std::filesystem::path file_, partial_;
  Temporary temporary_;
  Existing existing_ = Existing::refuse;
  Descriptor descriptor_;
};

/// All bytes of a regular file of at most limits::file_bytes. Fails with "FILE: what is wrong".
Result<std::string> read_bytes(const std::filesystem::path& file);

/// What is in a folder, in no order; nothing where there is no such folder. Fails with "FOLDER: cannot be listed
/// (REASON)", also where the listing ends in its middle.
Result<std::vector<std::filesystem::directory_entry>> entries_of(const std::filesystem::path& folder);

/// Whether both names lead, or would lead, to one file: by device and inode, so also through links; files that do not
/// exist yet by their place. Character devices (/dev/null) count as two files.
bool is_same_file(const std::filesystem::path& a, const std::filesystem::path& b);

/// The standard stream (stdout or stderr) that a file is, such as /dev/stdout. Opening it again would begin at the
/// start of a redirected file.
std::optional<int> standard_stream(const struct stat& file);

/// Renames, but never onto a file that exists: EEXIST then. Returns 0 or errno.
int rename_to_free_name(const std::filesystem::path& from, const std::filesystem::path& to);

/// The first of NAME, NAME-2, NAME-3, ... that does not exist; a dangling link exists.
std::filesystem::path free_name(const std::filesystem::path& name);

/// Forces a folder's entries to disk, where the file system can do that for folders.
Result<void> sync_folder(const std::filesystem::path& folder);

/// A new folder below the system's temporary one, "NAME-XXXXXX"; it is removed with what is in it, also by a signal.
class TemporaryFolder {
 public:
  explicit TemporaryFolder(std::string_view name);
  TemporaryFolder(const TemporaryFolder&) = delete;
  ~TemporaryFolder();
  /// Empty where it cannot be made.
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
  Temporary temporary_;
};

}  // namespace tribotwin::twin
