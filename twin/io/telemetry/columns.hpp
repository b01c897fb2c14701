#pragma once

#include <string>
#include <utility>
#include <variant>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

namespace tribotwin::twin {

/// A data set of one number or text per row.
struct Column {
  std::string path;  ///< GROUP/NAME or NAME; a '/' in a name is written %2F (column_name)
  std::string description;
  std::variant<std::vector<double>, std::vector<std::string>> values;
};

/// A name that may stand in a path.
std::string column_name(const std::string& name);

/// The bytes of an HDF5 file with these columns and attributes of its root; the same columns give the same bytes.
/// ErrorKind::work with HDF5's reason.
Result<std::string> columns_hdf5(const std::vector<Column>& columns,
                                 const std::vector<std::pair<std::string, std::string>>& attributes);

}  // namespace tribotwin::twin
