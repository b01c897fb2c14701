#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

namespace tribotwin::twin {

/// An HDF5 file of columns as columns_hdf5() and h5py write them: data sets of one dimension and equal length at the
/// root, of numbers or of text; others are passed over. Rows are read in blocks. A child process reads all of the file
/// first, because damaged files crash HDF5. Messages name the file.
class ColumnReader {
 public:
  static constexpr std::size_t rows_at_once = 16384;  ///< a block of a table that does not fit into memory

  static Result<ColumnReader> open(const std::filesystem::path& file);
  ColumnReader(ColumnReader&&) noexcept;
  ~ColumnReader();

  const std::vector<std::string>& names() const;
  std::size_t rows() const;
  /// `count` rows of a column. Fails where it is not of that kind.
  Result<std::vector<double>> numbers(std::size_t column, std::size_t from, std::size_t count) const;
  Result<std::vector<std::string>> texts(std::size_t column, std::size_t from, std::size_t count) const;

 private:
  struct Made;
  explicit ColumnReader(std::unique_ptr<Made> made);
  std::unique_ptr<Made> made_;
};

}  // namespace tribotwin::twin
