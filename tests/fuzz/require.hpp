#pragma once

#include <cstdio>
#include <cstdlib>

/// Ends the program with `what` where an invariant does not hold.
inline void require(bool held, const char* what) {
  if (held) return;
  std::fprintf(stderr, "%s\n", what);
  std::abort();
}
