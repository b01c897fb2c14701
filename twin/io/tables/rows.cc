#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/plugins/friction/text.hpp>
#include <tribotwin/twin/io/tables/column_map.hpp>
#include <tribotwin/twin/io/tables/csv.hpp>
#include <tribotwin/twin/io/tables/layout.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/io/tables/rows.hpp>
#include <tribotwin/twin/io/telemetry/column_reader.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using tables::CsvLines, tables::Pick;

/// Which column of the file is which.
struct Meaning {
  std::vector<std::optional<std::size_t>> texts;  ///< place among the wanted, by column of the file
  std::vector<std::optional<Pick>> numbers;
  std::vector<bool> has_text, has_number;
};

Result<Meaning> meaning_of(const fs::path& file, const std::vector<std::string>& headers,
                           const TableRows::Wanted& wanted, const fs::path& columns) {
  Meaning out{.texts = std::vector<std::optional<std::size_t>>(headers.size()),
              .numbers = std::vector<std::optional<Pick>>(headers.size()),
              .has_text = std::vector<bool>(wanted.texts.size()),
              .has_number = std::vector<bool>(wanted.numbers.size())};
  std::vector<std::string> mapped(wanted.texts.size());
  if (!columns.empty()) {
    auto map = read_text_map(columns, wanted.texts);
    if (!map) return tl::unexpected(map.error());
    mapped = std::move(*map);
  }
  for (std::size_t k = 0; k < wanted.texts.size(); ++k) {
    const std::string& name = mapped[k].empty() ? wanted.texts[k] : mapped[k];
    const auto count = std::ranges::count(headers, name);
    if (count > 1) return tl::unexpected(Error(fmt::format("{}:1: two columns {}", file.string(), shown(name))));
    if (count == 0 && !mapped[k].empty())
      return tl::unexpected(Error(fmt::format("{}: {}: {} has no column {}; the header names {}", columns.string(),
                                              wanted.texts[k], file.string(), shown(name), shown(headers))));
    if (count == 0) continue;
    out.texts[static_cast<std::size_t>(std::ranges::find(headers, name) - headers.begin())] = k;
    out.has_text[k] = true;
  }
  const auto layout = tables::lay_out(file, headers, wanted.numbers,
                                      {.columns = columns, .torque_constant = {}, .gear_ratio = {}}, wanted.texts);
  if (!layout) return tl::unexpected(layout.error());
  const auto picks = layout->picks(wanted.numbers);
  if (!picks) return tl::unexpected(picks.error());
  for (const Pick& pick : *picks) {
    if (pick.rate_hz > 0 || pick.date) continue;
    out.numbers[pick.header] = pick;
    out.has_number[pick.place] = true;
  }
  return out;
}

class CsvRows final : public TableRows {
 public:
  CsvRows(const fs::path& file, CsvLines lines, std::vector<std::string> headers, Meaning meaning)
      : file_(file.string()), lines_(std::move(lines)), headers_(std::move(headers)), meaning_(std::move(meaning)) {
    has_text_ = meaning_.has_text, has_number_ = meaning_.has_number;
    texts_.resize(has_text_.size());
    numbers_.resize(has_number_.size(), std::numeric_limits<double>::quiet_NaN());
  }

  Result<bool> next() override {
    std::string_view line;
    const auto more = lines_.next(line);
    if (!more) return tl::unexpected(more.error());
    if (!*more) {
      if (const auto problem = number_.ambiguous())
        return tl::unexpected(Error(fmt::format("{}:{}: {}", file_, problem->first, problem->second)));
      return false;
    }
    std::optional<std::string> problem;
    const auto count = lines_.cells(line, [&](std::size_t column, std::string_view cell) {
      if (column >= headers_.size()) return true;
      if (const auto& text = meaning_.texts[column]) texts_[*text].assign(cell);
      if (const auto& pick = meaning_.numbers[column]) problem = take(*pick, cell);
      return !problem;
    });
    if (problem) return tl::unexpected(Error(fmt::format("{}: {}", where(), *problem)));
    if (!count) return tl::unexpected(count.error());
    if (*count != headers_.size())
      return tl::unexpected(Error(fmt::format("{}: {} cells but {} columns", where(), *count, headers_.size())));
    return true;
  }
  std::string where() const override { return fmt::format("{}:{}", file_, lines_.number()); }
  std::size_t line() const override { return lines_.number(); }

 private:
  std::optional<std::string> take(const Pick& pick, std::string_view cell) {
    // Without a comma in sight a point decides.
    std::optional<double> x = lines_.separator() == ',' && !cell.empty() ? to_number(cell) : std::nullopt;
    if (!x) {
      const auto read = number_(cell, lines_.number());
      if (!read) return fmt::format("{} is {}", headers_[pick.header], read.error().message);
      x = *read;
    }
    numbers_[pick.place] = pick.value(*x);
    return std::nullopt;
  }

  const std::string file_;
  CsvLines lines_;
  const std::vector<std::string> headers_;
  const Meaning meaning_;
  tables::CsvNumber number_;
};

class Hdf5Rows final : public TableRows {
 public:
  Hdf5Rows(const fs::path& file, ColumnReader reader, Meaning meaning)
      : file_(file.string()), reader_(std::move(reader)), meaning_(std::move(meaning)) {
    has_text_ = meaning_.has_text, has_number_ = meaning_.has_number;
    texts_.resize(has_text_.size()), text_block_.resize(has_text_.size());
    numbers_.resize(has_number_.size(), std::numeric_limits<double>::quiet_NaN());
    number_block_.resize(has_number_.size());
  }

  Result<bool> next() override {
    if (row_ == reader_.rows()) return false;
    if (row_ == end_)
      if (auto ok = read(); !ok) return tl::unexpected(ok.error());
    const std::size_t i = row_++ - begin_;
    for (std::size_t k = 0; k < texts_.size(); ++k)
      if (has_text_[k]) texts_[k] = text_block_[k][i];
    for (std::size_t k = 0; k < numbers_.size(); ++k)
      if (has_number_[k]) numbers_[k] = number_block_[k][i];
    return true;
  }
  std::string where() const override { return fmt::format("{}: row {}", file_, row_); }
  std::size_t line() const override { return row_; }

 private:
  Result<void> read() {
    begin_ = row_, end_ = std::min(row_ + ColumnReader::rows_at_once, reader_.rows());
    for (std::size_t column = 0; column < meaning_.texts.size(); ++column) {
      if (const auto& text = meaning_.texts[column]) {
        auto block = reader_.texts(column, begin_, end_ - begin_);
        if (!block) return tl::unexpected(block.error());
        text_block_[*text] = std::move(*block);
      }
      const auto& pick = meaning_.numbers[column];
      if (!pick) continue;
      auto block = reader_.numbers(column, begin_, end_ - begin_);
      if (!block) return tl::unexpected(block.error());
      for (double& x : *block) x = pick->value(x);
      number_block_[pick->place] = std::move(*block);
    }
    return {};
  }

  const std::string file_;
  ColumnReader reader_;
  const Meaning meaning_;
  std::size_t row_ = 0, begin_ = 0, end_ = 0;
  std::vector<std::vector<std::string>> text_block_;
  std::vector<std::vector<double>> number_block_;
};

}  // namespace

Result<std::unique_ptr<TableRows>> TableRows::open(const fs::path& file, const Wanted& wanted,
                                                   const fs::path& columns) {
  if (const auto hdf5 = record_of(file)) {
    auto reader = ColumnReader::open(*hdf5);
    if (!reader) return tl::unexpected(reader.error());
    auto meaning = meaning_of(*hdf5, reader->names(), wanted, columns);
    if (!meaning) return tl::unexpected(meaning.error());
    return std::make_unique<Hdf5Rows>(*hdf5, *std::move(reader), *std::move(meaning));
  }
  auto lines = CsvLines::open(file);
  if (!lines) return tl::unexpected(lines.error());
  auto header = lines->header();
  if (!header) return tl::unexpected(header.error());
  auto meaning = meaning_of(file, *header, wanted, columns);
  if (!meaning) return tl::unexpected(meaning.error());
  return std::make_unique<CsvRows>(file, *std::move(lines), *std::move(header), *std::move(meaning));
}

}  // namespace tribotwin::twin
