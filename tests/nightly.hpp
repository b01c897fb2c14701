#pragma once

#include <cstdlib>
#include <string_view>

/// Whether the environment has TRIBOTWIN_NIGHTLY=1: then tests that otherwise take a part take the whole.
inline bool nightly() {
  const char* value = std::getenv("TRIBOTWIN_NIGHTLY");
  return value && std::string_view(value) == "1";
}
