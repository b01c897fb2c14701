#include <algorithm>
#include <cassert>
#include <cstdint>
#include <utility>

#include <tribotwin/twin/io/text_table.hpp>

namespace tribotwin::twin {
namespace {

struct Character {
  std::uint32_t code;
  std::size_t bytes;
};

/// The first character of a text that is not empty.
Character first_of(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const std::size_t bytes = byte(0) < 0xC0 ? 1 : byte(0) < 0xE0 ? 2 : byte(0) < 0xF0 ? 3 : 4;
  if (bytes == 1 || bytes > text.size()) return {byte(0), 1};
  std::uint32_t code = byte(0) & (0xFFU >> (bytes + 1));
  for (std::size_t i = 1; i < bytes; ++i) {
    if ((byte(i) & 0xC0) != 0x80) return {byte(0), 1};
    code = code << 6 | (byte(i) & 0x3F);
  }
  return {code, bytes};
}

struct Range {
  std::uint32_t from, to;
};

/// Combining marks and characters without width.
constexpr Range invisible[] = {{0x0300, 0x036F}, {0x1AB0, 0x1AFF}, {0x1DC0, 0x1DFF}, {0x200B, 0x200F},
                               {0x20D0, 0x20FF}, {0x3099, 0x309A}, {0xFE00, 0xFE0F}, {0xFE20, 0xFE2F}};
/// Wide and fullwidth: Unicode Standard Annex 11, in blocks.
constexpr Range wide[] = {{0x1100, 0x115F}, {0x2E80, 0x303E},   {0x3041, 0xA4CF},   {0xA960, 0xA97F},
                          {0xAC00, 0xD7A3}, {0xF900, 0xFAFF},   {0xFE30, 0xFE6F},   {0xFF00, 0xFF60},
                          {0xFFE0, 0xFFE6}, {0x1F300, 0x1F64F}, {0x1F900, 0x1F9FF}, {0x20000, 0x3FFFD}};

bool in(const auto& ranges, std::uint32_t code) {
  return std::ranges::any_of(ranges, [code](const Range& r) { return code >= r.from && code <= r.to; });
}

}  // namespace

std::size_t display_width(std::string_view text) {
  std::size_t width = 0;
  while (!text.empty()) {
    const auto [code, bytes] = first_of(text);
    width += in(invisible, code) ? 0 : in(wide, code) ? 2 : 1;
    text.remove_prefix(bytes);
  }
  return width;
}

TextTable::TextTable(std::vector<Column> columns) : columns_(std::move(columns)) {
  std::vector<std::string> heads;
  for (const Column& column : columns_) heads.push_back(column.head);
  if (std::ranges::any_of(heads, [](const std::string& head) { return !head.empty(); })) add(std::move(heads));
}

void TextTable::add(std::vector<std::string> cells) {
  assert(cells.size() <= columns_.size());
  rows_.push_back(std::move(cells));
}

std::string TextTable::text() const {
  std::vector<std::size_t> widths(columns_.size());
  for (const auto& row : rows_)
    for (std::size_t c = 0; c < row.size(); ++c)
      if (c == 0 || c + 1 < row.size() || row.size() == columns_.size())
        widths[c] = std::max(widths[c], display_width(row[c]));
  std::string text;
  for (const auto& row : rows_) {
    std::string line;
    for (std::size_t c = 0; c < row.size(); ++c) {
      const bool remark = c > 0 && c + 1 == row.size() && row.size() < columns_.size();
      const std::string blanks(remark ? 0 : widths[c] - display_width(row[c]), ' ');
      line += (c ? "  " : "") + (columns_[c].right ? blanks + row[c] : row[c] + blanks);
    }
    line.erase(line.find_last_not_of(' ') + 1);
    text += line + '\n';
  }
  return text;
}

}  // namespace tribotwin::twin
