#pragma once

#include <string_view>

namespace tribotwin::twin {

/// Writes all of `bytes`, waiting where a pipe is slow. Returns 0, or errno of the write that failed. A signal that
/// sets interrupted() ends the wait (EINTR).
int write_all(int descriptor, std::string_view bytes);

}  // namespace tribotwin::twin
