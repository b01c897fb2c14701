#pragma once

#include <atomic>
#include <filesystem>
#include <fstream>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/descriptor.hpp>

/// Signals, and waits that they end.

namespace tribotwin::twin {

/// Installs handlers for SIGINT, SIGTERM and SIGHUP: the first signal sets interrupted(), a second one terminates the
/// program. Blocking system calls return EINTR. Before this call they terminate the program.
void catch_interrupts();

/// In a process that works for its parent: SIGUSR1, which the parent sends, sets interrupted(); SIGTERM ends it;
/// signals of the terminal, which the parent gets too, do nothing.
void obey_parent_only();

/// Whether the user wants the program to end. Also set when the result is no longer needed.
std::atomic<bool>& interrupted();

/// FIFOs by name (mkfifo). Opening one waits until another program has opened its other end; here a note says for whom
/// the program waits, and a signal that sets interrupted() ends the wait. Pipes without a name, as bash's <(COMMAND),
/// have their other end already.
bool is_named_pipe(const std::filesystem::path& file);

/// Waits until the pipe has a reader. Fails with the reason.
Result<Descriptor> open_for_reader(const std::filesystem::path& pipe);

/// Waits until the pipe has sent something. Fails with the reason.
Result<std::ifstream> open_from_writer(const std::filesystem::path& pipe);

}  // namespace tribotwin::twin
