#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

/// What a command may write to: nothing that it reads, nothing twice, nothing that holds a session already.
namespace tribotwin::hil {

/// A file of a command and how the user named it: "-o s.log".
struct NamedFile {
  std::string name;
  std::filesystem::path path;
};

/// A scenario's file and the files that it names.
std::vector<NamedFile> files_of(const twin::Scenario& scenario);
/// What a session leaves in the folder of -o, and the folder.
std::vector<NamedFile> files_in(const std::filesystem::path& directory);

/// Fails where an output is an input or another output: one file by device and inode, so also through links; files that
/// do not exist yet by their place. Devices (/dev/null) may be both.
Result<void> refuse_shared(const std::vector<NamedFile>& inputs, const std::vector<NamedFile>& outputs);

/// Fails where an output holds something already: a session on a bus cannot be repeated.
Result<void> refuse_recorded(const std::vector<NamedFile>& outputs);

}  // namespace tribotwin::hil
