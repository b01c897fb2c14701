#include <algorithm>

#include <fmt/format.h>

#include <tribotwin/twin/identification/time_series.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::identification {

Result<Numbers> read_time_series(const std::filesystem::path& file, const std::vector<std::string>& needed,
                                 const std::vector<std::string>& optional, std::vector<std::string>& notes,
                                 const TableOptions& options) {
  std::vector<std::string> wanted = needed;
  wanted.insert(wanted.end(), optional.begin(), optional.end());
  auto table = read_numbers(file, wanted, options);
  if (!table) return table;
  for (const auto& name : needed)
    if (!table->has(name))
      return tl::unexpected(fmt::format("{}:1: no column {}; {}the columns are {}, and may be {}; the header names {}",
                                        file.string(), name, table->hint(name), joined(needed), joined(optional),
                                        table->header));
  notes.insert(notes.end(), table->notes.begin(), table->notes.end());
  const auto& time = table->columns[0];
  if (time.empty())
    return tl::unexpected(table->left_out
                              ? fmt::format("{}: no row without an empty, NaN or infinite cell", file.string())
                              : fmt::format("{}: is empty: a header but no samples", file.string()));
  if (const auto problem = not_increasing(*table, time)) return tl::unexpected(*problem);
  if (3 * table->left_out > time.size() + table->left_out)
    return tl::unexpected(fmt::format("{}: {} of {} rows hold no finite numbers; too few are left for a recording",
                                      file.string(), table->left_out, time.size() + table->left_out));
  if (table->left_out)
    notes.push_back(fmt::format("{}: {} rows with empty, NaN or infinite cells are left out, the first in {} {}",
                                file.string(), table->left_out, table->row, table->first_left_out));
  return table;
}

std::optional<std::string> implausible_temperature(const std::filesystem::path& file, std::string_view column,
                                                   std::span<const double> degC) {
  constexpr double minimum = -60, maximum = 250;
  if (degC.empty()) return {};
  const auto [low, high] = std::ranges::minmax(degC);
  if (low >= minimum && high <= maximum) return {};
  return fmt::format(
      "{}: {} goes from {:.4g} to {:.4g}, where a gearbox is between {:g} and {:g}; are these kelvins, or is it "
      "another column?",
      file.string(), column, low, high, minimum, maximum);
}

}  // namespace tribotwin::twin::identification
