#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/tables/column.hpp>

namespace tribotwin::twin {

/// A small CSV file with its cells as text, for columns of names. Numbers alone: read_numbers().
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

}  // namespace tribotwin::twin
