#pragma once

#include <filesystem>
#include <fstream>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/descriptor.hpp>

/// FIFOs by name (mkfifo). Opening one waits until another program has opened its other end; here a note says for whom
/// the program waits, and a signal that sets interrupted() ends the wait. Pipes without a name, as bash's <(COMMAND),
/// have their other end already.
namespace tribotwin::twin {

bool is_named_pipe(const std::filesystem::path& file);

/// Waits until the pipe has a reader. Fails with the reason.
Result<Descriptor> open_for_reader(const std::filesystem::path& pipe);

/// Waits until the pipe has sent something. Fails with the reason.
Result<std::ifstream> open_from_writer(const std::filesystem::path& pipe);

}  // namespace tribotwin::twin
