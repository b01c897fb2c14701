#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <sstream>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/twin/io/table.hpp>

namespace tribotwin::twin {

namespace {

/// The first whose ending a name has. Wide: what is merely unlikely (degrees, kelvins) is told by those who know the
/// joint.
constexpr struct {
  std::string_view ending;
  Quantity quantity;
} quantities[] = {{"_degC", {" degC", -273.15, 1000}}, {"_rad_s", {" rad/s", -1e6, 1e6}},
                  {"_m_s", {" m/s", -1e4, 1e4}},       {"_s", {" s", -1e10, 1e10}},
                  {"_nm", {" Nm", -1e7, 1e7}},         {"_n", {" N", -1e7, 1e7}},
                  {"_rad", {" rad", -1e6, 1e6}},       {"_m", {" m", -1e6, 1e6}},
                  {"_norm", {"", -1e6, 1e6}},          {"", {"", -1e12, 1e12}}};
constexpr Quantity power{" W", -1e7, 1e7};
constexpr double shortest_step_s = 1e-9;

}  // namespace

const Quantity& quantity_of(std::string_view column) {
  if (column.starts_with("power_w")) return power;
  return std::ranges::find_if(quantities, [&](const auto& q) { return column.ends_with(q.ending); })->quantity;
}

std::string Quantity::requirement() const {
  return fmt::format("must be within {:g} .. {:g}{}", minimum, maximum, unit);
}

bool Table::has(std::string_view name) const { return std::ranges::find(names, name) != names.end(); }

std::string Table::where(std::size_t row) const { return fmt::format("{}:{}: ", file.string(), lines[row]); }

Result<std::vector<double>> Table::numbers(std::string_view name) const {
  const auto at = std::ranges::find(names, name);
  if (at == names.end())
    return tl::unexpected(
        fmt::format("{}:1: no column '{}'; its header names: {}", file.string(), name, fmt::join(names, ", ")));
  const auto column = static_cast<std::size_t>(at - names.begin());
  std::vector<double> values;
  for (std::size_t row = 0; row < rows.size(); ++row) {
    const std::string& cell = rows[row][column];
    double x = 0;
    const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), x);
    if (error != std::errc{} || end != cell.data() + cell.size() || !std::isfinite(x))
      return tl::unexpected(fmt::format("{}column '{}' is '{}', not a finite number", where(row), name, cell));
    if (!quantity_of(name).contains(x))
      return tl::unexpected(
          fmt::format("{}column '{}' is {} but {}", where(row), name, cell, quantity_of(name).requirement()));
    values.push_back(x);
  }
  return values;
}

namespace {

Result<std::ifstream> opened(const std::filesystem::path& file) {
  std::error_code error;
  if (std::filesystem::is_directory(file, error))
    return tl::unexpected(fmt::format("{}: is a folder, not a CSV file", file.string()));
  std::ifstream stream(file);
  if (!stream) return tl::unexpected(fmt::format("{}: cannot be read ({})", file.string(), std::strerror(errno)));
  return stream;
}

std::string_view trimmed(std::string_view cell) {
  const auto first = cell.find_first_not_of(" \t\r"), last = cell.find_last_not_of(" \t\r");
  return first == cell.npos ? std::string_view{} : cell.substr(first, last - first + 1);
}

}  // namespace

Result<Numbers> read_numbers(const std::filesystem::path& file, const std::vector<std::string>& wanted) {
  auto stream = opened(file);
  if (!stream) return tl::unexpected(stream.error());
  Numbers numbers{.file = file, .names = {}, .columns = std::vector<std::vector<double>>(wanted.size()), .lines = {}};
  std::vector<Quantity> quantity;
  for (const auto& name : wanted) quantity.push_back(quantity_of(name));
  std::string line;
  if (!std::getline(*stream, line))
    return tl::unexpected(fmt::format("{}: is empty; its first line should name the columns", file.string()));
  constexpr std::size_t none = static_cast<std::size_t>(-1);
  std::vector<std::size_t> wanted_at;  // per column of the file
  for (std::string_view rest = line; true;) {
    const auto comma = rest.find(',');
    const std::string name(trimmed(rest.substr(0, comma)));
    const auto found = std::ranges::find(wanted, name);
    if (std::ranges::find(numbers.names, name) != numbers.names.end())
      return tl::unexpected(fmt::format("{}:1: column '{}' twice", file.string(), name));
    numbers.names.push_back(name);
    wanted_at.push_back(found == wanted.end() ? none : static_cast<std::size_t>(found - wanted.begin()));
    if (comma == rest.npos) break;
    rest.remove_prefix(comma + 1);
  }
  std::vector<double> row(wanted.size());
  for (std::size_t number = 2; std::getline(*stream, line); ++number) {
    if (trimmed(line).empty()) continue;
    std::size_t column = 0;
    bool finite = true;
    for (std::string_view rest = line; true; ++column) {
      const auto comma = rest.find(',');
      if (column < wanted_at.size() && wanted_at[column] != none) {
        std::string_view cell = trimmed(rest.substr(0, comma));
        if (cell.starts_with('+')) cell.remove_prefix(1);
        double x = std::numeric_limits<double>::quiet_NaN();
        const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), x);
        if (!cell.empty() && (error != std::errc{} || end != cell.data() + cell.size()))
          return tl::unexpected(fmt::format("{}:{}: column '{}' is '{}', not a number", file.string(), number,
                                            numbers.names[column], cell));
        if (std::isfinite(x) && !quantity[wanted_at[column]].contains(x))
          return tl::unexpected(fmt::format("{}:{}: column '{}' is {} but {}", file.string(), number,
                                            numbers.names[column], cell, quantity[wanted_at[column]].requirement()));
        row[wanted_at[column]] = x;
        finite &= std::isfinite(x);
      }
      if (comma == rest.npos) break;
      rest.remove_prefix(comma + 1);
    }
    if (column + 1 != wanted_at.size())
      return tl::unexpected(
          fmt::format("{}:{}: {} cells but {} columns", file.string(), number, column + 1, wanted_at.size()));
    if (!finite) {
      if (numbers.left_out++ == 0) numbers.first_left_out = number;
      continue;
    }
    numbers.lines.push_back(number);
    for (const std::size_t k : wanted_at)
      if (k != none) numbers.columns[k].push_back(row[k]);
  }
  return numbers;
}

std::optional<std::string> not_increasing(const Numbers& numbers, const std::vector<double>& time_s) {
  for (std::size_t i = 1; i < time_s.size(); ++i)
    if (!(time_s[i] - time_s[i - 1] >= shortest_step_s))
      return fmt::format(
          "{}:{}: time_s {} does not come after {}; it must increase from row to row, recordings made one by one are "
          "files of their own",
          numbers.file.string(), numbers.lines[i], time_s[i], time_s[i - 1]);
  return std::nullopt;
}

Result<Table> read_table(const std::filesystem::path& file) {
  auto opening = opened(file);
  if (!opening) return tl::unexpected(opening.error());
  std::ifstream& stream = *opening;
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
  if (!std::getline(stream, line))
    return tl::unexpected(fmt::format("{}: is empty; its first line should name the columns", file.string()));
  table.names = cells_of(line);
  for (std::size_t number = 2; std::getline(stream, line); ++number) {
    auto cells = cells_of(line);
    if (cells.empty()) continue;
    if (cells.size() != table.names.size())
      return tl::unexpected(
          fmt::format("{}:{}: {} cells but {} columns", file.string(), number, cells.size(), table.names.size()));
    table.rows.push_back(std::move(cells));
    table.lines.push_back(number);
  }
  if (table.rows.empty()) return tl::unexpected(fmt::format("{}: is empty: a header but no samples", file.string()));
  return table;
}

}  // namespace tribotwin::twin
