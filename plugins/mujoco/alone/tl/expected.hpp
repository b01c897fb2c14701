#pragma once

// Stands in for tl::expected where the plugin is built alone, which needs C++23 there.
#include <expected>

namespace tl {
using std::expected;
using std::unexpected;
}  // namespace tl
