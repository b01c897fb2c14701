#pragma once

#include <filesystem>
#include <string>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/commands/table.hpp>
#include <tribotwin/twin/io/command_line/command_line.hpp>
#include <tribotwin/twin/io/destination.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/output.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/io/tables/table_options.hpp>
#include <tribotwin/twin/io/text_table.hpp>

/// What the commands of the program `tribotwin` share. A command is one file and one row of table.hpp. Its work returns
/// an exit code or an error; the callback throws the error (or_throw), and parse.hpp maps it to an exit code.
namespace tribotwin::twin::program {

/// "tribotwin: MESSAGE" on stderr; returns the exit code. For limits; errors are returned.
inline Exit report_error(Exit code, const std::string& message) {
  twin::report_error("tribotwin", code, message);
  return code;
}

/// Before any work: throws InputError where -o names what cannot be written or is one of `inputs`.
inline void check(const Destination& output, const std::vector<std::filesystem::path>& inputs) {
  or_wrong_input(output.check(inputs));
}
inline std::vector<std::filesystem::path> paths(const std::vector<std::string>& files) {
  return {files.begin(), files.end()};
}

/// Throws InputError where two recordings have the same content.
inline void refuse_twice(const std::vector<std::string>& recordings) {
  if (const auto why = given_twice(paths(recordings))) throw InputError(*why);
}

/// Writes the result to the file of -o, or to stdout without one.
inline Result<Exit> deliver(const std::string& text, const Destination& output = {}) {
  if (auto ok = output.deliver(text); !ok) return tl::unexpected(ok.error());
  return done;
}

}  // namespace tribotwin::twin::program
