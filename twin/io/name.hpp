#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace tribotwin::twin {

/// Why `name` cannot name a new file or folder; nothing where it can. A name is one component of a path, of 1 to 200
/// bytes, neither "." nor "..", without control characters. Every name that a user's file gives to a file is checked
/// here.
std::optional<std::string> unfit_file_name(std::string_view name);

}  // namespace tribotwin::twin
