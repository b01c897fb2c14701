#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/io/table.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin {

namespace {

/// The first entry whose ending a column's name has applies. The ranges are wide: those who know the joint judge what
/// is merely unlikely (degrees for kelvins).
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
        fmt::format("{}:1: no column '{}'; its header names: {}", file.string(), name, joined(names)));
  const auto column = static_cast<std::size_t>(at - names.begin());
  std::vector<double> values;
  for (std::size_t row = 0; row < rows.size(); ++row) {
    const std::string& cell = rows[row][column];
    const auto x = to_number(cell);
    if (!x || !std::isfinite(*x))
      return tl::unexpected(fmt::format("{}column '{}' is '{}', not a finite number", where(row), name, cell));
    if (!quantity_of(name).contains(*x))
      return tl::unexpected(
          fmt::format("{}column '{}' is {} but {}", where(row), name, cell, quantity_of(name).requirement()));
    values.push_back(*x);
  }
  return values;
}

namespace {

Error at_line(const std::filesystem::path& file, std::size_t line, const std::string& what) {
  return fmt::format("{}:{}: {}", file.string(), line, what);
}

constexpr std::size_t unwanted = static_cast<std::size_t>(-1);

/// Calls `each` with the number and the text of every cell until it returns false; returns how many it was called for.
template <class Each>
std::size_t for_each_cell(std::string_view line, const Each& each) {
  for (std::size_t column = 0; true; ++column) {
    const auto comma = line.find(',');
    if (!each(column, trimmed(line.substr(0, comma))) || comma == line.npos) return column + 1;
    line.remove_prefix(comma + 1);
  }
}

/// Reads the rows below the header into `numbers`, one line at a time.
class RowReader {
 public:
  RowReader(Numbers& numbers, const std::vector<std::string>& wanted) : numbers_(numbers), row_(wanted.size()) {
    for (const auto& name : wanted) quantities_.push_back(quantity_of(name));
    for (const auto& name : numbers.names) {
      const auto found = std::ranges::find(wanted, name);
      place_.push_back(found == wanted.end() ? unwanted : static_cast<std::size_t>(found - wanted.begin()));
    }
  }

  Result<void> add(std::string_view line, std::size_t number) {
    if (trimmed(line).empty()) return {};
    bool finite = true;
    Result<void> read;
    const std::size_t cells = for_each_cell(line, [&](std::size_t column, std::string_view cell) {
      if (column >= place_.size() || place_[column] == unwanted) return true;
      const auto x = value(column, cell, number);
      if (!x) return read = tl::unexpected(x.error()), false;
      row_[place_[column]] = *x;
      finite &= std::isfinite(*x);
      return true;
    });
    if (!read) return read;
    if (cells != place_.size())
      return tl::unexpected(
          at_line(numbers_.file, number, fmt::format("{} cells but {} columns", cells, place_.size())));
    keep(number, finite);
    return {};
  }

 private:
  Result<double> value(std::size_t column, std::string_view cell, std::size_t number) const {
    if (cell.starts_with('+')) cell.remove_prefix(1);
    if (cell.empty()) return std::numeric_limits<double>::quiet_NaN();
    const auto x = to_number(cell);
    const auto fail = [&](const std::string& what) {
      return tl::unexpected(
          at_line(numbers_.file, number, fmt::format("column '{}' is {}", numbers_.names[column], what)));
    };
    if (!x) return fail(fmt::format("'{}', not a number", cell));
    const Quantity& quantity = quantities_[place_[column]];
    if (std::isfinite(*x) && !quantity.contains(*x))
      return fail(fmt::format("{} but {}", cell, quantity.requirement()));
    return *x;
  }

  void keep(std::size_t number, bool finite) {
    if (!finite) {
      if (numbers_.left_out++ == 0) numbers_.first_left_out = number;
      return;
    }
    numbers_.lines.push_back(number);
    for (const std::size_t k : place_)
      if (k != unwanted) numbers_.columns[k].push_back(row_[k]);
  }

  Numbers& numbers_;
  std::vector<Quantity> quantities_;  // of the wanted columns
  std::vector<std::size_t> place_;    // among the wanted, per column of the file
  std::vector<double> row_;
};

std::vector<std::string> cells_of(std::string line) {
  if (!line.empty() && line.back() == '\r') line.pop_back();
  std::vector<std::string> cells;
  std::istringstream in(line);
  for (std::string cell; std::getline(in, cell, ',');) {
    const auto first = cell.find_first_not_of(" \t"), last = cell.find_last_not_of(" \t");
    cells.push_back(first == std::string::npos ? "" : cell.substr(first, last - first + 1));
  }
  return cells;
}

Error no_header(const std::filesystem::path& file) {
  return fmt::format("{}: is empty; its first line should name the columns", file.string());
}

}  // namespace

Result<Numbers> read_numbers(const std::filesystem::path& file, const std::vector<std::string>& wanted) {
  auto stream = open_text(file, "a CSV file");
  if (!stream) return tl::unexpected(stream.error());
  Numbers numbers{.file = file, .names = {}, .columns = std::vector<std::vector<double>>(wanted.size()), .lines = {}};
  std::string line;
  if (!std::getline(*stream, line)) return tl::unexpected(no_header(file));
  std::optional<std::string> twice;
  for_each_cell(line, [&](std::size_t, std::string_view name) {
    if (std::ranges::find(numbers.names, name) != numbers.names.end()) twice = name;
    numbers.names.emplace_back(name);
    return !twice;
  });
  if (twice) return tl::unexpected(at_line(file, 1, fmt::format("column '{}' twice", *twice)));
  RowReader reader(numbers, wanted);
  for (std::size_t number = 2; std::getline(*stream, line); ++number)
    if (auto ok = reader.add(line, number); !ok) return tl::unexpected(ok.error());
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
  auto stream = open_text(file, "a CSV file");
  if (!stream) return tl::unexpected(stream.error());
  Table table{.file = file, .names = {}, .rows = {}, .lines = {}};
  std::string line;
  if (!std::getline(*stream, line)) return tl::unexpected(no_header(file));
  table.names = cells_of(line);
  for (std::size_t number = 2; std::getline(*stream, line); ++number) {
    auto cells = cells_of(line);
    if (cells.empty()) continue;
    if (cells.size() != table.names.size())
      return tl::unexpected(
          at_line(file, number, fmt::format("{} cells but {} columns", cells.size(), table.names.size())));
    table.rows.push_back(std::move(cells));
    table.lines.push_back(number);
  }
  if (table.rows.empty()) return tl::unexpected(fmt::format("{}: is empty: a header but no samples", file.string()));
  return table;
}

}  // namespace tribotwin::twin
