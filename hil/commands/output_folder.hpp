#pragma once

#include <filesystem>
#include <span>
#include <string>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/file.hpp>

/// A result that is several files in one folder, for a command that makes all of them at once. (A run that grows has
/// twin::RunFolder.)
namespace tribotwin::hil {

/// A file of the folder: its name there and its content.
struct OutputFile {
  std::string name, bytes;
};

/// Its last name, also of "runs/" and ".".
std::string name_of_folder(const std::filesystem::path& folder);

/// Whether `folder` may become an output: for the start of a command, before its work. Refuses what is no folder, a
/// name in a folder that does not exist, and a folder that holds anything (unless it may be replaced).
Result<void> check_output_folder(const std::filesystem::path& folder, twin::Existing existing);

/// Writes the files under a hidden name, forces them to disk and moves them into place. A folder that did not exist is
/// there with all files or not at all. In one that exists (--force) each file is the old or the new one, and
/// files of other names stay.
Result<void> write_folder(const std::filesystem::path& folder, std::span<const OutputFile> files,
                          twin::Existing existing);

}  // namespace tribotwin::hil
