#pragma once

#include <atomic>

namespace tribotwin::twin {

/// Installs handlers for SIGINT, SIGTERM and SIGHUP: the first signal sets interrupted(), a second one terminates the
/// program. Blocking system calls return EINTR. Before this call they terminate the program.
void catch_interrupts();

/// Whether the user wants the program to end. Also set when the result is no longer needed.
std::atomic<bool>& interrupted();

}  // namespace tribotwin::twin
