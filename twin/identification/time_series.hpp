#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/table.hpp>

/// Recordings sample by sample, for what has a memory.
namespace tribotwin::twin::identification {

/// The columns `needed`, of which the first is time_s, then those of `optional` that the file has (else empty). Time
/// must increase from row to row; rows without a number are left out, which `notes` tells. Fails with file and what
/// would be right.
Result<Numbers> read_time_series(const std::filesystem::path& file, const std::vector<std::string>& needed,
                                 const std::vector<std::string>& optional, std::vector<std::string>& notes);

/// Why this column cannot be degrees Celsius of a gearbox.
std::optional<std::string> implausible_temperature(const std::filesystem::path& file, std::string_view column,
                                                   std::span<const double> degC);

}  // namespace tribotwin::twin::identification
