#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <tribotwin/twin/simulation/scenario.hpp>

/// What a command may write to: nothing that it reads, nothing twice, nothing that holds a session already.
namespace tribotwin::hil {

/// A file of a command and how the user named it: "--csv s.log".
struct NamedFile {
  std::string name;
  std::filesystem::path path;
};

/// A scenario's file and the files that it names.
std::vector<NamedFile> files_of(const twin::Scenario& scenario);
/// What a session leaves in the folder of -o, and the folder.
std::vector<NamedFile> files_in(const std::filesystem::path& directory);

/// Throws twin::InputError where an output is an input or another output: one file by device and inode, so also through
/// links; files that are not there yet by their place. Devices (/dev/null) may be both.
void refuse_shared(const std::vector<NamedFile>& inputs, const std::vector<NamedFile>& outputs);

/// Throws twin::InputError where an output holds something already. Whoever was on a bus will not say it again.
void refuse_recorded(const std::vector<NamedFile>& outputs);

}  // namespace tribotwin::hil
