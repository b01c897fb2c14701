#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace tribotwin::twin {

/// Columns that a UTF-8 text takes on a terminal: one per character, two for those of East Asia and pictographs, none
/// for combining marks. A byte that is no UTF-8 counts as one character.
std::size_t display_width(std::string_view text);

/// A table for terminals, the only one. Columns are as wide as their widest cell and two blanks apart, whatever the
/// cells hold.
class TextTable {
 public:
  struct Column {
    std::string head;
    bool right = true;  ///< aligned; for numbers
  };
  static Column left(std::string head = {}) { return {std::move(head), false}; }
  static Column right(std::string head = {}) { return {std::move(head), true}; }

  explicit TextTable(std::vector<Column> columns);

  /// A row, of at most as many cells as there are columns. The last cell of a shorter one is a remark that may stand
  /// over the columns behind it.
  void add(std::vector<std::string> cells);
  /// A line per row below that of the heads, where any column has one.
  std::string text() const;

 private:
  std::vector<Column> columns_;
  std::vector<std::vector<std::string>> rows_;
};

}  // namespace tribotwin::twin
