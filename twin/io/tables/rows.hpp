#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

namespace tribotwin::twin {

/// A table of names and numbers, one row after the other: memory does not grow with it. CSV, with any of its separators
/// and decimal signs, or HDF5 with one data set per column at its root (columns_hdf5, h5py). Units of numbers and the
/// file of --columns as in read_numbers(); in that file a name is mapped by `NAME: FOREIGN`.
class TableRows {
 public:
  virtual ~TableRows() = default;

  struct Wanted {
    std::vector<std::string> texts, numbers;  ///< names of the convention, in base units
  };
  static Result<std::unique_ptr<TableRows>> open(const std::filesystem::path& file, const Wanted& wanted,
                                                 const std::filesystem::path& columns);

  /// Whether the table has the column.
  bool has_text(std::size_t k) const { return has_text_[k]; }
  bool has_number(std::size_t k) const { return has_number_[k]; }

  /// The next row; false at the end. Fails with file and line where a cell is no number.
  virtual Result<bool> next() = 0;
  /// Of the row; empty and NaN where the table has no such column, or an empty cell.
  const std::string& text(std::size_t k) const { return texts_[k]; }
  double number(std::size_t k) const { return numbers_[k]; }
  /// "FILE:LINE", or "FILE: row N", and the number alone.
  virtual std::string where() const = 0;
  virtual std::size_t line() const = 0;

 protected:
  std::vector<bool> has_text_, has_number_;
  std::vector<std::string> texts_;
  std::vector<double> numbers_;
};

}  // namespace tribotwin::twin
