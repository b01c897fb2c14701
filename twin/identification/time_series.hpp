#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>

/// Recordings sample by sample, for models with a state.
namespace tribotwin::twin::identification {

/// A step longer than this many typical ones is a gap: nothing is filtered or differentiated across it.
constexpr double gap_steps = 2.5;

/// The columns `needed`, of which the first is time_s, then those of `optional` (empty where the file has none). Time
/// must increase from row to row. Rows with a cell that is no finite number are left out, with a note. ErrorKind::input
/// with file and what would be right.
Result<Numbers> read_time_series(const std::filesystem::path& file, const std::vector<std::string>& needed,
                                 const std::vector<std::string>& optional, std::vector<std::string>& notes,
                                 const TableOptions& options = {});

/// Why a column is implausible as the temperature of a gearbox: outside -60 .. 250 degC.
std::optional<std::string> implausible_temperature(const std::filesystem::path& file, std::string_view column,
                                                   std::span<const double> degC);

}  // namespace tribotwin::twin::identification
