#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

namespace tribotwin::twin {

/// Unit and plausible range of a measured number. A number outside is no measurement of a joint.
struct Quantity {
  std::string_view unit;
  double minimum, maximum;

  bool contains(double value) const { return value >= minimum && value <= maximum; }
  /// "must be within MINIMUM .. MAXIMUM UNIT"
  std::string requirement() const;
};
/// The quantity by the unit in a column's name: "time_s", "torque_joint2_nm", "power_w_joint2".
const Quantity& quantity_of(std::string_view column);

/// A CSV file whose first line names its columns. Cells are separated by commas and not quoted.
struct Table {
  std::filesystem::path file;
  std::vector<std::string> names;
  std::vector<std::vector<std::string>> rows;  ///< as many cells as names
  std::vector<std::size_t> lines;              ///< of the file, from 1, per row

  bool has(std::string_view name) const;
  /// A column of numbers within the range of its quantity. Fails with file, line, column and the wrong cell, or with
  /// the names of the columns.
  Result<std::vector<double>> numbers(std::string_view name) const;
  /// "FILE:LINE: " of a row
  std::string where(std::size_t row) const;
};

/// Fails with file and line; a table without samples is an error.
Result<Table> read_table(const std::filesystem::path& file);

/// Columns of numbers from a file too long to keep as text.
struct Numbers {
  std::filesystem::path file;
  std::vector<std::string> names;            ///< all columns of the header
  std::vector<std::vector<double>> columns;  ///< of the wanted names, in their order; empty where the file has none
  std::vector<std::size_t> lines;            ///< of the file, from 1, per row
  std::size_t left_out = 0;                  ///< rows in which a wanted cell is empty, NaN or infinite
  std::size_t first_left_out = 0;            ///< its line, from 1
};

/// Reads the columns `wanted` of a CSV file in one pass. Fails with file and line, also where a cell is no number or
/// outside the range of its quantity.
Result<Numbers> read_numbers(const std::filesystem::path& file, const std::vector<std::string>& wanted);

/// The first row of `time_s` that does not come after the row before, by a nanosecond at least, with file and line.
std::optional<std::string> not_increasing(const Numbers& numbers, const std::vector<double>& time_s);

}  // namespace tribotwin::twin
