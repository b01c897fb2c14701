#pragma once

#include <string>

#include <tribotwin/hil/session/drive.hpp>

namespace tribotwin::hil::program {

/// The state of a session in one line of at most `columns` - 1 characters, so that no terminal wraps it: what matters
/// least is shortened first, then left out.
std::string status_line(const SessionStatus& status, int columns);

/// Width of the terminal on stderr; COLUMNS where it does not say, 80 without either.
int terminal_columns();

}  // namespace tribotwin::hil::program
