#pragma once

#include <filesystem>
#include <optional>
#include <string>

/// Private to this folder: the variables of a MATLAB file one behind the other, without what is in them.
namespace tribotwin::twin::tables {

/// Why a file of version 4 or 5 (to 7) is not whole: libmatio ends its list of variables where the file is cut off, and
/// gives those before. Nothing for v7.3, whose length HDF5 checks, and for what is no MATLAB file.
/// Source: MathWorks, MAT-File Format, R2023b, chapters 1 and 2.
std::optional<std::string> cut_off(const std::filesystem::path& file);

}  // namespace tribotwin::twin::tables
