#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace tribotwin::twin {

/// Why `name` cannot be the name of a file or folder that is made: one component of a path, of 1 to 200 bytes, neither
/// "." nor
/// "..", without control characters. Nothing where it can. Whatever a user's file names and becomes a file goes through
/// here.
std::optional<std::string> unfit_file_name(std::string_view name);

}  // namespace tribotwin::twin
