#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/tables/column.hpp>

namespace tribotwin::twin {

/// One entry of the file of --columns. value = unit(sign x scale x number + offset), in the unit's base.
struct MappedColumn {
  ColumnName name;
  std::string from;       ///< the foreign name, as the table has it
  double factor, offset;  ///< value in the base unit = factor x number + offset
  double rate_hz = 0;     ///< above 0: no column but the time of rows at this rate, the first at 0
  bool date = false;      ///< the cells are dates and times by ISO 8601; the value is in s
  std::string where;      ///< "FILE: KEY", for messages

  /// A '*' in the joint's name stands for what the '*' in `from` is in the names of the table.
  bool is_pattern() const { return name.joint.find('*') != name.joint.npos; }
};

/// Reads
///
///     position_joint1_rad: q1                                        # the unit is that of the key
///     torque_joint1_nm: {from: I1, unit: mNm, scale: 0.1, offset: 2, sign: -1}
///     velocity_joint*_rad_s: 'qd(:,*)'                               # joint1 to joint7 from qd(:,1) to qd(:,7)
///     time_s: {from: Timestamp, unit: iso8601}                       # or {rate_hz: 500}, where the table has no time
///
/// Fails with file, line and key.
/// `texts`: keys that stand for columns of text and are left out here.
Result<std::vector<MappedColumn>> read_column_map(const std::filesystem::path& file,
                                                  const std::vector<std::string>& texts = {});

/// The foreign names of columns of text, in their order; empty where the file does not map one.
Result<std::vector<std::string>> read_text_map(const std::filesystem::path& file,
                                               const std::vector<std::string>& texts);

}  // namespace tribotwin::twin
