#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include <tribotwin/plugins/friction/error.hpp>

/// Private to this folder.
namespace tribotwin::twin::tables {

/// Numbers with a decimal point or, in the whole file alike, a decimal comma.
class CsvNumber {
 public:
  /// The number of a cell, NaN where it is empty; fails with what is wrong.
  Result<double> operator()(std::string_view cell, std::size_t line);
  /// At the end of the file: why its commas cannot be understood, with the line.
  std::optional<std::pair<std::size_t, std::string>> ambiguous() const;

 private:
  std::string thousands() const;

  std::size_t comma_line_ = 0, point_line_ = 0;  // the first of each, 0: none
  bool decided_ = false;                         // a cell shows that commas are decimal
  std::string first_, buffer_;
};

}  // namespace tribotwin::twin::tables
