#pragma once

#include <span>
#include <string>
#include <utility>
#include <vector>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/plugins/friction/error.hpp>

/// The MJCF vocabulary of a drive: the keys of `<config key= value=/>`. The drive's own keys are one table; the
/// parameters of laws and thermal models have their own tables.
namespace tribotwin::drive {

using Configuration = std::vector<std::pair<std::string, std::string>>;

/// Every key that some drive may have, for engines that want them declared. Storage is static.
std::span<const char* const> all_keys();

/// A drive from its configuration. Fails with a sentence that names key, value and what would be right; the caller adds
/// the element.
Result<Drive> make_drive(std::string name, const Configuration& configuration);

/// The drive of actuator `index` of the `count` that share an instance: a value stands for all of them, or there is one
/// for each, separated by spaces (lists of load tables stand for all). Its name is INSTANCE/JOINT. With a count of 1 it
/// is that of make_drive.
Result<Drive> make_shared_drive(const std::string& instance, const std::string& joint,
                                const Configuration& configuration, std::size_t index, std::size_t count);

/// The configuration that `make_drive` would read back to the same drive.
Configuration configuration_of(const Drive& drive);

/// The tables of keys, laws and thermal models as Markdown: the reference part of plugins/README.md.
std::string reference_markdown();

}  // namespace tribotwin::drive
