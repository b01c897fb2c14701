#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <fstream>
#include <limits>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/input_file.hpp>
#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/plugins/friction/text.hpp>
#include <tribotwin/twin/io/tables/csv.hpp>
#include <tribotwin/twin/io/tables/source.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::tables {
namespace {

constexpr double nan_value = std::numeric_limits<double>::quiet_NaN();

Error at_line(const std::filesystem::path& file, std::size_t line, const std::string& what) {
  return fmt::format("{}:{}: {}", file.string(), line, what);
}

/// Seconds since 1970 of 2022-10-26T08:17:21.847Z; also with a blank for the T, an offset +01:00, or neither.
std::optional<double> seconds_of_date(std::string_view text) {
  const auto digits = [&](std::size_t at, std::size_t count) -> std::optional<int> {
    return at + count <= text.size() ? to_integer<int>(text.substr(at, count)) : std::nullopt;
  };
  const auto sign = [&](std::size_t at, std::string_view any) {
    return at < text.size() && any.find(text[at]) != any.npos;
  };
  const auto year = digits(0, 4), month = digits(5, 2), day = digits(8, 2), hour = digits(11, 2),
             minute = digits(14, 2);
  if (!year || !month || !day || !hour || !minute || !sign(4, "-") || !sign(7, "-") || !sign(10, "T ") ||
      !sign(13, ":") || !sign(16, ":"))
    return std::nullopt;
  const std::chrono::year_month_day date{std::chrono::year(*year), std::chrono::month(static_cast<unsigned>(*month)),
                                         std::chrono::day(static_cast<unsigned>(*day))};
  std::size_t end = 17;
  while (end < text.size() && ((text[end] >= '0' && text[end] <= '9') || text[end] == '.' || text[end] == ',')) ++end;
  std::string seconds(text.substr(17, end - 17));
  std::ranges::replace(seconds, ',', '.');
  const auto second = to_number(seconds);
  double offset_s = 0;
  const std::string_view zone = text.substr(end);
  if (!zone.empty() && zone != "Z") {
    const auto h = digits(end + 1, 2), m = digits(zone.size() == 6 ? end + 4 : end + 3, 2);
    if ((zone[0] != '+' && zone[0] != '-') || (zone.size() != 6 && zone.size() != 5) || !h || !m) return std::nullopt;
    offset_s = (zone[0] == '-' ? -1 : 1) * (*h * 3600.0 + *m * 60.0);
  }
  if (!date.ok() || *hour < 0 || *hour > 23 || *minute < 0 || *minute > 59 || !second ||
      !(*second >= 0 && *second < 61))
    return std::nullopt;
  const auto days = std::chrono::sys_days(date).time_since_epoch().count();
  return static_cast<double>(days) * 86400 + *hour * 3600 + *minute * 60 + *second - offset_s;
}

class CsvSource final : public Source {
 public:
  CsvSource(std::filesystem::path file, CsvLines lines, std::vector<std::string> headers)
      : file_(std::move(file)), lines_(std::move(lines)), headers_(std::move(headers)) {}

  const std::vector<std::string>& headers() const override { return headers_; }
  std::string_view row() const override { return "line"; }

  Result<void> read(std::span<const Pick> picks, Numbers& numbers) override {
    std::vector<const Pick*> by_header(headers_.size(), nullptr);
    for (const Pick& pick : picks)
      if (pick.rate_hz == 0) by_header[pick.header] = &pick;
    std::vector<double> row(numbers.columns.size(), nan_value);
    std::string_view line;
    for (;;) {
      const auto next = lines_.next(line);
      if (!next) return tl::unexpected(next.error());
      if (!*next) break;
      if (auto ok = add(line, by_header, picks, row, numbers); !ok) return ok;
    }
    if (const auto problem = number_.ambiguous())
      return tl::unexpected(at_line(file_, problem->first, problem->second));
    return {};
  }

 private:
  Result<void> add(std::string_view line, const std::vector<const Pick*>& by_header, std::span<const Pick> picks,
                   std::vector<double>& row, Numbers& numbers) {
    bool finite = true;
    Result<void> read;
    const auto cells = lines_.cells(line, [&](std::size_t column, std::string_view cell) {
      if (column >= by_header.size() || !by_header[column]) return true;
      const auto x = value(column, cell, *by_header[column]);
      if (!x) return read = tl::unexpected(at_line(file_, lines_.number(), x.error().message)), false;
      row[by_header[column]->place] = *x;
      finite &= std::isfinite(*x);
      return true;
    });
    if (!read) return read;
    if (!cells) return tl::unexpected(cells.error());
    if (*cells != headers_.size())
      return tl::unexpected(at_line(file_, lines_.number(),
                                    fmt::format("{} cells but {} columns{}", *cells, headers_.size(), hint(*cells))));
    for (const Pick& pick : picks)
      if (pick.rate_hz > 0) row[pick.place] = static_cast<double>(rows_) / pick.rate_hz;
    ++rows_;
    if (!finite) {
      if (numbers.left_out++ == 0) numbers.first_left_out = lines_.number();
      return {};
    }
    if ((numbers.lines.size() + 1) * (picks.size() + 1) * sizeof(double) > limits::csv_numbers_bytes)
      return tl::unexpected(at_line(file_, lines_.number(),
                                    fmt::format("is beyond {} rows, the most that are read of so many columns; give a "
                                                "part of the recording, or leave samples out",
                                                numbers.lines.size())));
    numbers.lines.push_back(lines_.number());
    for (const Pick& pick : picks) numbers.columns[pick.place].push_back(row[pick.place]);
    return {};
  }

  std::string hint(std::size_t cells) const {
    if (headers_.size() == 1)
      return "; the first line is taken for the names of the columns: take lines before these out";
    if (lines_.separator() == ',' && cells > headers_.size())
      return "; where numbers have decimal commas, cells are separated by ';' or tabs";
    return "";
  }

  Result<double> value(std::size_t column, std::string_view cell, const Pick& pick) {
    const auto fail = [&](const std::string& what) {
      return tl::unexpected(Error(fmt::format("column {} is {}", shown(headers_[column]), what)));
    };
    double x = nan_value;
    if (pick.date) {
      if (cell.empty()) return x;
      const auto seconds = seconds_of_date(cell);
      if (!seconds) return fail(fmt::format("{}, no date and time like 2022-10-26T08:17:21.847Z", shown(cell)));
      x = *seconds;
    } else {
      const auto number = number_(cell, lines_.number());
      if (!number) return fail(number.error().message);
      x = pick.value(*number);
    }
    if (std::isfinite(x) && !pick.quantity.contains(x))
      return fail(pick.as_it_is ? fmt::format("{} but {}", printable(cell), pick.quantity.requirement())
                                : fmt::format("{}, which is {:g}{}, but {}", printable(cell), x, pick.quantity.unit,
                                              pick.quantity.requirement()));
    return x;
  }

  std::filesystem::path file_;
  CsvLines lines_;
  std::vector<std::string> headers_;
  CsvNumber number_;
  std::size_t rows_ = 0;
};

/// The separator by the header: the only one of the three that it has; where it has several, the one that cuts the
/// first row into as many cells.
Result<char> separator_of(const std::filesystem::path& file, std::string_view header, std::string_view first_row) {
  std::vector<char> candidates;
  for (const char c : {';', '\t', ','})
    if (CsvLines::count_cells(header, c) > 1) candidates.push_back(c);
  if (candidates.empty()) return ',';
  if (candidates.size() == 1) return candidates.front();
  std::erase_if(candidates,
                [&](char c) { return CsvLines::count_cells(header, c) != CsvLines::count_cells(first_row, c); });
  // Without a header, in a file with decimal commas.
  if (candidates.size() == 2 && candidates.back() == ',' &&
      header.find_first_not_of("+-0123456789.,;\teE ") == header.npos)
    candidates.pop_back();
  if (candidates.size() == 1) return candidates.front();
  return tl::unexpected(at_line(file, 1,
                                "the separator is ambiguous: the header has several of ';', tab and ','; use one, and "
                                "quote names that contain another"));
}

}  // namespace

std::size_t CsvLines::count_cells(std::string_view line, char separator) {
  std::size_t count = 1;
  bool quoted = false;
  for (const char c : line) {
    if (c == '"') quoted = !quoted;
    count += !quoted && c == separator;
  }
  return count;
}

bool CsvLines::read_bytes(std::string& line) {
  if (from_ >= block_.size()) {
    from_ = 0, block_.clear();
    if (!read_line(stream_, line, limits::csv_line_bytes + 1)) return false;
    if (line.size() > limits::csv_line_bytes + line.ends_with('\r')) return true;  // read() refuses it
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (line.find('\r') == line.npos) return true;
    block_.swap(line);
  }
  const std::size_t end = std::min(block_.find('\r', from_), block_.size());
  line.assign(block_, from_, end - from_);
  from_ = end + 1;
  return true;
}

Result<bool> CsvLines::read(std::string& line) {
  if (!read_bytes(line)) return stream_.bad() ? Result<bool>(not_read(file_.string())) : false;
  ++read_;
  if (line.size() > limits::csv_line_bytes)
    return tl::unexpected(at_line(file_, read_,
                                  fmt::format("is longer than {} MiB, the most that a line of a CSV file has",
                                              limits::csv_line_bytes / limits::MiB)));
  if (line.starts_with("SQLite format 3"))
    return tl::unexpected(fmt::format(
        "{}: is an SQLite database, as a rosbag in .db3 is, and no table; 'ros2 bag convert' makes an MCAP of it "
        "(storage_id: mcap), which is read",
        file_.string()));
  auto utf8 = to_utf8(std::move(line), read_);
  if (!utf8) return tl::unexpected(fmt::format("{}:{}", file_.string(), utf8.error().message));
  line = std::move(*utf8);
  if (line.find('\0') != line.npos)
    return tl::unexpected(at_line(file_, read_, "holds a NUL byte; this is no CSV file in ASCII or UTF-8"));
  return true;
}

Result<CsvLines> CsvLines::open(const std::filesystem::path& file) {
  auto stream = open_text(file, "a CSV file");
  if (!stream) return tl::unexpected(stream.error());
  CsvLines out(file, std::move(*stream));
  const auto header = out.read(out.header_);
  if (!header) return tl::unexpected(header.error());
  char given = 0;  // by the line with which Excel says it
  if (out.header_.size() == 5 && out.header_.starts_with("sep=") &&
      std::string_view(";\t,").find(out.header_[4]) != std::string_view::npos) {
    given = out.header_[4];
    if (const auto next = out.read(out.header_); !next) return tl::unexpected(next.error());
  }
  if (!*header || trimmed(out.header_).empty())
    return tl::unexpected(fmt::format("{}: is empty; its first line should name the columns", file.string()));
  const auto first = out.read(out.pending_);
  if (!first) return tl::unexpected(first.error());
  out.has_pending_ = *first;
  const auto separator = given ? given : separator_of(file, out.header_, out.pending_);
  if (!separator) return tl::unexpected(separator.error());
  out.separator_ = *separator;
  if (out.only_numbers(out.header_)) out.name_by_number();
  out.number_ = (out.named_ ? 1 : 0) + (given ? 1 : 0);
  return out;
}

bool CsvLines::only_numbers(std::string_view line) const {
  std::size_t numbers = 0;
  const auto cells_read = cells(line, [&](std::size_t, std::string_view cell) {
    std::string text(cell);
    std::ranges::replace(text, ',', '.');
    const auto x = to_number(text);
    numbers += x && std::isfinite(*x);
    return text.empty() || (x && std::isfinite(*x));
  });
  return cells_read && numbers > 1 && *cells_read == count_cells(line, separator_);
}

void CsvLines::name_by_number() {
  named_ = false;
  second_ = std::exchange(pending_, header_);
  has_second_ = std::exchange(has_pending_, true);
}

Result<std::vector<std::string>> CsvLines::header() const {
  std::vector<std::string> names;
  if (!named_) {
    for (std::size_t k = 1; k <= count_cells(header_, separator_); ++k) names.push_back(fmt::format("column {}", k));
    return names;
  }
  // As NumPy and MATLAB write it: a comment.
  const bool comment = header_.starts_with('#') || header_.starts_with('%');
  const auto count = cells(std::string_view(header_).substr(comment ? 1 : 0), [&](std::size_t, std::string_view name) {
    names.emplace_back(name);
    return true;
  });
  if (!count) return tl::unexpected(count.error());
  return names;
}

Result<bool> CsvLines::next(std::string_view& line) {
  for (;;) {
    if (std::exchange(has_pending_, false)) {
      line_.swap(pending_);
      pending_.swap(second_);
      has_pending_ = std::exchange(has_second_, false);
    } else if (const auto read_one = read(line_); !read_one || !*read_one) {
      return read_one;
    }
    ++number_;
    if (trimmed(line_).empty()) continue;
    line = line_;
    return true;
  }
}

Error CsvLines::open_quote() const { return at_line(file_, number_, "a quote \" is not closed in its line"); }

Opened open_csv(const std::filesystem::path& file) {
  auto lines = CsvLines::open(file);
  if (!lines) return tl::unexpected(lines.error());
  auto headers = lines->header();
  if (!headers) return tl::unexpected(headers.error());
  return std::make_unique<CsvSource>(file, std::move(*lines), std::move(*headers));
}

}  // namespace tribotwin::twin::tables
