#pragma once

#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

#include <tribotwin/plugins/friction/error.hpp>

/// All text files are opened here. `kind` completes "FILE: is a folder, not ...", for example "a YAML file".
namespace tribotwin::twin {

Result<std::ifstream> open_text(const std::filesystem::path& file, std::string_view kind);

/// The whole content.
Result<std::string> read_text(const std::filesystem::path& file, std::string_view kind);

}  // namespace tribotwin::twin
