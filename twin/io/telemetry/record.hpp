#pragma once

#include <span>
#include <vector>

#include <tribotwin/twin/io/descriptor.hpp>
#include <tribotwin/twin/io/telemetry/hdf5.hpp>

/// A record being written.
namespace tribotwin::twin::hdf5 {

constexpr std::size_t block = 4096;       // samples per write
constexpr std::size_t chunk_rows = 1024;  // rows that a damaged chunk of a dataset loses

/// Fails while a run is writing the file.
void refuse_if_in_use(const fs::path& path);

/// A time column and the columns that share its length, with their rows not yet written.
struct Table {
  struct Column {
    Id dataset;
    std::vector<double> pending;
  };
  Column time;
  std::vector<Column> columns;
  hsize_t written = 0;

  std::size_t pending() const { return time.pending.size(); }
  void push(double time_s, std::span<const double> values) {
    time.pending.push_back(time_s);
    for (std::size_t i = 0; i < columns.size(); ++i) columns[i].pending.push_back(values[i]);
  }
  /// Bytes that the file may grow by when `rows` more are written: whole chunks and their index.
  hsize_t growth(hsize_t rows) const;
  /// Time goes last: a reader never sees an instant whose values are missing.
  void write();
};

/// A record being written.
struct Record {
  Descriptor descriptor;
  Id file, complete;
  Table samples, cycles;
  hsize_t reserved = 0;

  /// Reserves the disk space of the next write, because a write that fails half way leaves a file that HDF5 cannot
  /// open.
  void reserve(hsize_t bytes);
  void mark_complete(unsigned char value) {
    check(H5Dwrite(complete, H5T_NATIVE_UINT8, H5S_ALL, H5S_ALL, H5P_DEFAULT, &value));
  }
  void close();
  void close_on_disk();  ///< ... and forces it to disk
  /// Writes nothing more, as if the process had been killed: what SWMR readers see stays whole, where closing the file
  /// after a failed write would mix old and new parts of its index.
  void abandon();
};

/// Creates the file anew, with all that comes before the first sample.
Record create_record(const fs::path& path, const TelemetryOptions& options);

}  // namespace tribotwin::twin::hdf5
