#include <tribotwin/twin/table/table.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <fstream>
#include <sstream>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace tribotwin::twin {

bool Table::has(std::string_view name) const { return std::ranges::find(names, name) != names.end(); }

std::string Table::where(std::size_t row) const { return fmt::format("{}:{}: ", file.string(), lines[row]); }

tl::expected<std::vector<double>, std::string> Table::numbers(std::string_view name) const {
  const auto at = std::ranges::find(names, name);
  if (at == names.end()) return tl::unexpected(fmt::format("{}:1: no column '{}'; its header names: {}", file.string(), name, fmt::join(names, ", ")));
  const auto column = static_cast<std::size_t>(at - names.begin());
  std::vector<double> values;
  for (std::size_t row = 0; row < rows.size(); ++row) {
    const std::string& cell = rows[row][column];
    double x = 0;
    const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), x);
    if (error != std::errc{} || end != cell.data() + cell.size() || !std::isfinite(x))
      return tl::unexpected(fmt::format("{}column '{}' is '{}', not a finite number", where(row), name, cell));
    values.push_back(x);
  }
  return values;
}

tl::expected<Table, std::string> read_table(const std::filesystem::path& file) {
  std::error_code error;
  if (std::filesystem::is_directory(file, error)) return tl::unexpected(fmt::format("{}: is a folder, not a CSV file", file.string()));
  std::ifstream stream(file);
  if (!stream) return tl::unexpected(fmt::format("{}: cannot be read ({})", file.string(), std::strerror(errno)));
  const auto cells_of = [](std::string line) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    std::vector<std::string> cells;
    std::istringstream in(line);
    for (std::string cell; std::getline(in, cell, ',');) {
      const auto first = cell.find_first_not_of(" \t"), last = cell.find_last_not_of(" \t");
      cells.push_back(first == std::string::npos ? "" : cell.substr(first, last - first + 1));
    }
    return cells;
  };
  Table table{.file = file, .names = {}, .rows = {}, .lines = {}};
  std::string line;
  if (!std::getline(stream, line)) return tl::unexpected(fmt::format("{}: is empty; its first line should name the columns", file.string()));
  table.names = cells_of(line);
  for (std::size_t number = 2; std::getline(stream, line); ++number) {
    auto cells = cells_of(line);
    if (cells.empty()) continue;
    if (cells.size() != table.names.size()) return tl::unexpected(fmt::format("{}:{}: {} cells but {} columns", file.string(), number, cells.size(), table.names.size()));
    table.rows.push_back(std::move(cells));
    table.lines.push_back(number);
  }
  if (table.rows.empty()) return tl::unexpected(fmt::format("{}: is empty: a header but no samples", file.string()));
  return table;
}

}  // namespace tribotwin::twin
