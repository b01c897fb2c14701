#pragma once

#include <span>
#include <string>
#include <vector>

#include <tribotwin/twin/io/tables/column_map.hpp>
#include <tribotwin/twin/io/tables/source.hpp>

/// Private to this folder: what the columns of one table are by the convention.
namespace tribotwin::twin::tables {

struct LaidColumn {
  std::string name;                          ///< by the convention, in base units; foreign names as they are
  std::string joint;                         ///< of a name of the convention
  const ColumnQuantity* quantity = nullptr;  ///< nothing: foreign
  bool date = false;
  double rate_hz = 0;  ///< above 0: the time of rows, no column of the file
  double factor = 1, offset = 0;
  std::string problem;  ///< why a column that names a quantity cannot be used
};

/// One entry per name of the header, then those that no column of the file has.
struct Layout {
  std::filesystem::path file;
  std::vector<std::string> headers;
  std::vector<LaidColumn> columns;

  /// What the wanted columns are read with, in their order. Fails where a wanted quantity is there with a unit that
  /// is unknown, or twice.
  Result<std::vector<Pick>> picks(const std::vector<std::string>& wanted) const;
};

/// `texts`: names of columns of text, which the file of --columns may map too.
Result<Layout> lay_out(const std::filesystem::path& file, const std::vector<std::string>& headers,
                       const std::vector<std::string>& wanted, const TableOptions& options,
                       const std::vector<std::string>& texts = {});

}  // namespace tribotwin::twin::tables
