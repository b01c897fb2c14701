#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/tables/column.hpp>
#include <tribotwin/twin/io/tables/table_options.hpp>

namespace tribotwin::twin {

namespace tables {
class Source;
}

/// Columns of numbers of a table: CSV, telemetry.h5 or the folder of a run, NumPy .npy and .npz, MATLAB .mat, MCAP.
struct Numbers {
  std::filesystem::path file;
  std::vector<std::string> names;  ///< of all columns: by the convention, in base units; foreign names as they are
  std::string header;              ///< the names that the file itself has, for messages
  std::vector<std::vector<double>> columns = {};  ///< of the wanted names, in their order; empty where there is none
  std::vector<std::size_t> lines = {};            ///< of the file, from 1, per row
  std::size_t left_out = 0;                       ///< rows in which a wanted cell is empty, NaN or infinite
  std::size_t first_left_out = 0;                 ///< its line, from 1
  std::string_view row = "line";                  ///< "row" where the file has no lines
  std::vector<std::string> notes = {};            ///< how the file was understood, and what it lacks

  bool has(std::string_view name) const;
  /// What to say where there is no `name`, a torque, but the current from which it is made; else empty.
  std::string hint(std::string_view name) const;
  /// "FILE:LINE: " of a row, or "FILE: row N: ".
  std::string where(std::size_t index) const;
};

/// Reads the columns `wanted`, which are different names of the convention in base units (time_s, torque_joint1_nm;
/// empty ones stay empty), from any kind of table in one pass; other units are converted. Names without a joint are
/// those of options.joint, or of the only joint that the table has. Fails with file and line, also where a cell is no
/// number or outside the range of its quantity, and where the unit of a wanted quantity is unknown or ambiguous.
Result<Numbers> read_numbers(const std::filesystem::path& file, const std::vector<std::string>& wanted,
                             const TableOptions& options = {});

/// A table whose header has been read: for readers that choose their columns by it.
class OpenTable {
 public:
  /// `wanted`: where it is known already, what will be read; MCAP does not say by itself which joints slide.
  static Result<OpenTable> open(const std::filesystem::path& file, const TableOptions& options = {},
                                const std::vector<std::string>& wanted = {});
  OpenTable(OpenTable&&) noexcept;
  ~OpenTable();

  /// The columns of the table, none of them read. `wanted` decides whose joint a name is of. Fails as read() does, but
  /// for what stands below the header.
  Result<Numbers> header(const std::vector<std::string>& wanted = {}) const;
  /// As read_numbers(); once.
  Result<Numbers> read(const std::vector<std::string>& wanted);

 private:
  OpenTable(std::filesystem::path file, TableOptions options, std::unique_ptr<tables::Source> source);

  std::filesystem::path file_;
  TableOptions options_;
  std::unique_ptr<tables::Source> source_;
};

/// The first row of `time_s` that does not come after the row before, by a nanosecond at least, with file and line.
std::optional<std::string> not_increasing(const Numbers& numbers, const std::vector<double>& time_s);

/// Which two of the recordings have the same content, whatever their names: counted twice, they would make every sigma
/// too small. What is no regular file nor the folder of a run is not compared.
std::optional<std::string> given_twice(const std::vector<std::filesystem::path>& files);

/// The telemetry.h5 that `file` is, or that lies in the folder `file`; nothing where it is another kind of file.
std::optional<std::filesystem::path> record_of(const std::filesystem::path& file);

}  // namespace tribotwin::twin
