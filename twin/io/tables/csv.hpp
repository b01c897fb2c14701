#pragma once

#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/text.hpp>

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

/// The lines of a CSV file and their cells. Separated by ',', ';' or tabs, found by the header or said by Excel's line
/// "sep=;" before it; cells may be quoted, not over several lines; lines are UTF-8 or Windows-1252 (to_utf8) and end
/// with a line feed, a carriage return or both. The header may be a comment of '#' or '%'; where the first line holds
/// numbers alone, columns are called "column 1" and so on.
class CsvLines {
 public:
  /// Reads the header. Fails with file and line.
  static Result<CsvLines> open(const std::filesystem::path& file);

  Result<std::vector<std::string>> header() const;
  char separator() const { return separator_; }
  /// The next line that is not empty; false at the end.
  Result<bool> next(std::string_view& line);
  /// Its number in the file, from 1.
  std::size_t number() const { return number_; }

  /// Calls `each` with the number and the text of every cell until it returns false; returns for how many. Fails where
  /// a quote is not closed.
  template <class Each>
  Result<std::size_t> cells(std::string_view line, const Each& each) const {
    if (line.find('"') != line.npos) return quoted_cells(line, each);
    for (std::size_t column = 0; true; ++column) {
      const auto end = line.find(separator_);
      if (!each(column, trimmed(line.substr(0, end))) || end == line.npos) return column + 1;
      line.remove_prefix(end + 1);
    }
  }
  static std::size_t count_cells(std::string_view line, char separator);

 private:
  CsvLines(std::filesystem::path file, std::ifstream stream) : file_(std::move(file)), stream_(std::move(stream)) {}
  Result<bool> read(std::string& line);
  bool read_bytes(std::string& line);
  Error open_quote() const;
  bool only_numbers(std::string_view line) const;
  /// A file without a header: its first line is a row.
  void name_by_number();

  template <class Each>
  Result<std::size_t> quoted_cells(std::string_view line, const Each& each) const {
    std::string cell;
    bool quoted = false, was_quoted = false;
    std::size_t column = 0;
    for (std::size_t i = 0; i <= line.size(); ++i) {
      const bool end = i == line.size();
      if (end && quoted) return tl::unexpected(open_quote());
      if (end || (!quoted && line[i] == separator_)) {
        if (!each(column++, was_quoted ? std::string_view(cell) : trimmed(cell))) return column;
        cell.clear(), was_quoted = false;
      } else if (line[i] != '"') {
        cell += line[i];
      } else if (quoted && i + 1 < line.size() && line[i + 1] == '"') {
        cell += line[i++];
      } else {
        quoted = !quoted, was_quoted = true;
      }
    }
    return column;
  }

  std::filesystem::path file_;
  std::ifstream stream_;
  std::string header_, line_, pending_, second_;  // read ahead: the next line and the one after
  std::string block_;                             // up to the next line feed, where carriage returns alone end lines
  std::size_t from_ = 0;                          // of it, the next line
  bool has_pending_ = false, has_second_ = false;
  bool named_ = true;
  char separator_ = ',';
  std::size_t read_ = 0, number_ = 0;
};

}  // namespace tribotwin::twin::tables
