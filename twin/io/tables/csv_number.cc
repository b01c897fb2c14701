#include <algorithm>
#include <limits>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/io/tables/column.hpp>
#include <tribotwin/twin/io/tables/csv.hpp>

namespace tribotwin::twin::tables {
namespace {

/// Whether a number with one comma may also be one with a comma between thousands: 1,234 but not 0,234 or 1,23.
bool may_be_thousands(std::string_view cell) {
  if (!cell.empty() && (cell[0] == '-' || cell[0] == '+')) cell.remove_prefix(1);
  const auto comma = cell.find(',');
  const auto digits = [](std::string_view text) {
    return std::ranges::all_of(text, [](char c) { return c >= '0' && c <= '9'; });
  };
  return comma >= 1 && comma <= 3 && cell[0] != '0' && cell.size() == comma + 4 && digits(cell.substr(0, comma)) &&
         digits(cell.substr(comma + 1));
}

Error no_number(std::string_view cell) { return fmt::format("{}, not a number", shown(cell)); }
Result<double> mixed(std::string_view cell, std::string_view now, std::string_view before, std::size_t line) {
  return tl::unexpected(fmt::format("{} with a decimal {}, but line {} has a decimal {}; use one in the whole file",
                                    shown(cell), now, line, before));
}

}  // namespace

Result<double> CsvNumber::operator()(std::string_view cell, std::size_t line) {
  if (cell.starts_with('+')) cell.remove_prefix(1);
  if (cell.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto comma = cell.find(',');
  const bool point = cell.find('.') != cell.npos;
  if (comma == cell.npos) {
    if (point && !point_line_) point_line_ = line;
    if (point && comma_line_) return mixed(cell, "point", "comma", comma_line_);
    const auto x = to_number(cell);
    return x ? Result<double>(*x) : tl::unexpected(no_number(cell));
  }
  if (point || cell.find(',', comma + 1) != cell.npos)
    return tl::unexpected(fmt::format("{}, which separates thousands; write 1234.5 or 1234,5", shown(cell)));
  if (point_line_) return mixed(cell, "comma", "point", point_line_);
  if (!comma_line_) comma_line_ = line, first_ = cell;
  decided_ = decided_ || !may_be_thousands(cell);
  buffer_.assign(cell);
  buffer_[comma] = '.';
  const auto x = to_number(buffer_);
  return x ? Result<double>(*x) : tl::unexpected(no_number(cell));
}

std::optional<std::pair<std::size_t, std::string>> CsvNumber::ambiguous() const {
  if (!comma_line_ || decided_) return std::nullopt;
  return std::pair{comma_line_, fmt::format("{} may be {} or a number with a decimal comma, and so may every number "
                                            "with a comma in this file; write decimal points",
                                            shown(first_), thousands())};
}

std::string CsvNumber::thousands() const {
  std::string s = first_;
  std::erase(s, ',');
  return s;
}

}  // namespace tribotwin::twin::tables
