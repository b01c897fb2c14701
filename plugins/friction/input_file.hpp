#pragma once

#include <cstdint>
#include <filesystem>
#include <istream>
#include <string>
#include <string_view>

#include <tribotwin/plugins/friction/error.hpp>

/// Files that a user names, before and while they are read. `kind` completes "FILE: is a folder, not ...", for example
/// "a YAML file".
namespace tribotwin {

enum class Pipes { refuse, accept };

/// Fails where `file` is not there, is a folder, a socket or a device (but a terminal), or is longer than `most_bytes`.
/// A pipe has no length; what reads it stops at the limit (read_at_most).
Result<void> check_input_file(const std::filesystem::path& file, std::string_view kind, std::uintmax_t most_bytes,
                              Pipes pipes);

/// "FILE: cannot be read to its end (reason)", failed work; at once after reading failed, for the reason is errno. A
/// stream is bad() then; loops of getline take that for the end.
tl::unexpected<Error> not_read(std::string_view file);

/// The rest of the stream. Fails where that is more than `most_bytes`, of which it takes no more memory, and where the
/// machine cannot read on.
Result<std::string> read_at_most(std::istream& stream, std::string_view file, std::uintmax_t most_bytes);

/// All bytes of a regular file. Fails with the file's name.
Result<std::string> read_input_file(const std::filesystem::path& file, std::string_view kind,
                                    std::uintmax_t most_bytes);

/// The next line, without its line feed, as std::getline; of a line longer than `most_bytes` a part that is longer too,
/// by which the caller knows. false at the end, and where the machine cannot read on (stream.bad()).
bool read_line(std::istream& stream, std::string& line, std::size_t most_bytes);

}  // namespace tribotwin
