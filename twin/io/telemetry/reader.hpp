#pragma once

#include <vector>

#include <tribotwin/twin/io/telemetry/hdf5.hpp>

/// A record opened for reading.
namespace tribotwin::twin::hdf5 {

/// The columns of a file that share a time column: their common length and, joint by joint, their datasets.
struct Columns {
  Id time;
  std::vector<std::vector<Id>> joints;
  hsize_t rows = 0;
};

/// `head` is the record without the values.
struct Reader {
  fs::path path;
  Id file;
  bool plain = true;  ///< opens without SWMR, because its writer closed it
  Recording head;
  Columns samples, cycles;
};

/// Throws Failure. Does not follow links to other files, nor storage in other files.
Reader open_record(const fs::path& path);

/// Throws Failure where a part of these rows is missing from the file or has another checksum: HDF5 itself reads what
/// lies beyond the end of a file as zeros.
void read_rows(const Reader& reader, hid_t dataset, hsize_t from, std::span<double> values);

constexpr std::size_t rows_at_once = 4096;  ///< of an export: in memory

/// Rows of all columns of one table, column by column; time first.
class Rows {
 public:
  /// `at_once`: how many rows are in memory.
  Rows(const Reader& reader, const Columns& columns, std::size_t at_once);
  /// At most as many rows as are in memory. Throws Failure where a part of them is damaged.
  void read(hsize_t from, std::size_t count);
  double time_s(std::size_t row) const { return values_[row]; }
  /// The values of a row, joint by joint.
  void get(std::size_t row, std::vector<double>& values) const;

 private:
  const Reader& reader_;
  std::vector<hid_t> datasets_;
  std::vector<double> values_;
  std::size_t at_once_;
};

/// Reads all of a record once in a child process, because some damaged files crash HDF5 1.10. Fails where the child
/// crashes, where the file does not exist, and where the file cannot be read although nobody writes it.
Status probe(const fs::path& path);

}  // namespace tribotwin::twin::hdf5
