#pragma once

#include <atomic>
#include <filesystem>
#include <fstream>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/descriptor.hpp>

/// Signals, and waits that they end.

namespace tribotwin::twin {

/// A name that must not outlive the program. A file or folder of that name, with all that is in it, is removed where
/// the program ends before this object does: by SIGINT, SIGTERM or SIGHUP, by std::quick_exit or an exception that
/// nothing catches; not by kill -9 or a crash. Removing it otherwise is its owner's task. Of one process: its children
/// remove nothing. Threads may have temporaries at the same time, 256 in all; more than that, and names of PATH_MAX
/// bytes, are not removed.
class Temporary {
 public:
  Temporary() = default;
  /// The name may be that of nothing yet. A relative one is relative to the folder in which the program ends.
  explicit Temporary(const std::filesystem::path& name);
  Temporary(Temporary&& other) noexcept;
  Temporary& operator=(Temporary&& other) noexcept;
  ~Temporary();

 private:
  int slot_ = -1;
};

/// From now on SIGINT, SIGTERM and SIGHUP, where they are not ignored, and std::quick_exit remove what is temporary
/// before they end the program.
void remove_temporaries_at_end();

/// The same at once, before an end that does not do it.
void remove_temporaries();

/// Installs handlers for SIGINT, SIGTERM and SIGHUP, where they are not ignored: the first signal sets interrupted(); a
/// second one, the same or another, terminates the program. Blocking system calls return EINTR. Before this call they
/// terminate the program.
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
