#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/io/tables/csv.hpp>
#include <tribotwin/twin/io/tables/table.hpp>

namespace tribotwin::twin {

bool Table::has(std::string_view name) const { return std::ranges::find(names, name) != names.end(); }

std::string Table::where(std::size_t row) const { return fmt::format("{}:{}: ", file.string(), lines[row]); }

Result<std::vector<double>> Table::numbers(std::string_view name) const {
  const auto at = std::ranges::find(names, name);
  if (at == names.end())
    return tl::unexpected(fmt::format("{}:1: no column '{}'; its header names: {}", file.string(), name, shown(names)));
  const auto column = static_cast<std::size_t>(at - names.begin());
  std::vector<double> values;
  for (std::size_t row = 0; row < rows.size(); ++row) {
    const std::string& cell = rows[row][column];
    const auto x = to_number(cell);
    if (!x || !std::isfinite(*x))
      return tl::unexpected(fmt::format("{}column '{}' is {}, not a finite number", where(row), name, shown(cell)));
    if (!quantity_of(name).contains(*x))
      return tl::unexpected(
          fmt::format("{}column '{}' is {} but {}", where(row), name, cell, quantity_of(name).requirement()));
    values.push_back(*x);
  }
  return values;
}

Result<Table> read_table(const std::filesystem::path& file) {
  auto lines = tables::CsvLines::open(file);
  if (!lines) return tl::unexpected(lines.error());
  auto names = lines->header();
  if (!names) return tl::unexpected(names.error());
  Table table{.file = file, .names = std::move(*names), .rows = {}, .lines = {}};
  std::string_view line;
  std::uintmax_t bytes = 0;
  for (;;) {
    const auto next = lines->next(line);
    if (!next) return tl::unexpected(next.error());
    if (!*next) break;
    if ((bytes += line.size()) > limits::csv_text_bytes)
      return tl::unexpected(fmt::format("{}:{}: is beyond {} bytes, the most that is read of such a table",
                                        file.string(), lines->number(), limits::csv_text_bytes));
    std::vector<std::string> row;
    const auto cells = lines->cells(line, [&](std::size_t, std::string_view cell) {
      row.emplace_back(cell);
      return true;
    });
    if (!cells) return tl::unexpected(cells.error());
    if (*cells != table.names.size())
      return tl::unexpected(
          fmt::format("{}:{}: {} cells but {} columns", file.string(), lines->number(), *cells, table.names.size()));
    table.rows.push_back(std::move(row));
    table.lines.push_back(lines->number());
  }
  if (table.rows.empty()) return tl::unexpected(fmt::format("{}: is empty: a header but no samples", file.string()));
  return table;
}

}  // namespace tribotwin::twin
