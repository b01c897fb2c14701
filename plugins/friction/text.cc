#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/text.hpp>

namespace tribotwin {
namespace {

unsigned byte_of(char c) { return static_cast<unsigned char>(c); }

bool is_ascii(std::string_view text) {
  unsigned all = 0;  // without an early end, so that it is vectorised
  for (const char c : text) all |= byte_of(c);
  return all < 0x80;
}

/// The length of the well-formed UTF-8 sequence at the start (Unicode 15, table 3-7); 0: there is none.
std::size_t sequence_length(std::string_view text) {
  const unsigned first = byte_of(text[0]);
  if (first < 0x80) return 1;
  const std::size_t length = first >= 0xC2 && first <= 0xDF ? 2 : first >= 0xE0 && first <= 0xEF ? 3 : 4;
  if (first < 0xC2 || first > 0xF4 || text.size() < length) return 0;
  for (std::size_t i = 1; i < length; ++i)
    if ((byte_of(text[i]) & 0xC0) != 0x80) return 0;
  const unsigned second = byte_of(text[1]);
  const bool overlong = (first == 0xE0 && second < 0xA0) || (first == 0xF0 && second < 0x90),
             surrogate = first == 0xED && second > 0x9F, beyond = first == 0xF4 && second > 0x8F;
  return overlong || surrogate || beyond ? 0 : length;
}

/// Where the text stops to be UTF-8; its size where it never does.
std::size_t utf8_until(std::string_view text) {
  std::size_t at = 0;
  while (at < text.size()) {
    const std::size_t length = sequence_length(text.substr(at));
    if (length == 0) break;
    at += length;
  }
  return at;
}

/// Code points of the bytes 0x80 to 0x9F; 0: none. The bytes above are their own code points.
constexpr std::uint16_t windows_1252[] = {0x20AC, 0,      0x201A, 0x0192, 0x201E, 0x2026, 0x2020, 0x2021,
                                          0x02C6, 0x2030, 0x0160, 0x2039, 0x0152, 0,      0x017D, 0,
                                          0,      0x2018, 0x2019, 0x201C, 0x201D, 0x2022, 0x2013, 0x2014,
                                          0x02DC, 0x2122, 0x0161, 0x203A, 0x0153, 0,      0x017E, 0x0178};

/// Appends the byte as UTF-8; false where it is no letter.
bool append(std::string& to, unsigned byte) {
  const unsigned code = byte < 0x80 || byte > 0x9F ? byte : windows_1252[byte - 0x80];
  if (code == 0) return false;
  if (code < 0x80) {
    to += static_cast<char>(code);
  } else if (code < 0x800) {
    to += {static_cast<char>(0xC0 | code >> 6), static_cast<char>(0x80 | (code & 0x3F))};
  } else {
    to += {static_cast<char>(0xE0 | code >> 12), static_cast<char>(0x80 | (code >> 6 & 0x3F)),
           static_cast<char>(0x80 | (code & 0x3F))};
  }
  return true;
}

/// Appends a line as UTF-8. Fails with "byte 0x.. at N ..."
Result<void> append_line(std::string& to, std::string_view line) {
  if (utf8_until(line) == line.size()) {
    to += line;
    return {};
  }
  for (std::size_t i = 0; i < line.size(); ++i)
    if (!append(to, byte_of(line[i])))
      return tl::unexpected(
          Error(fmt::format("byte 0x{:02X} at {} is neither UTF-8 nor Windows-1252 (Latin-1); save the file as UTF-8",
                            byte_of(line[i]), i + 1)));
  return {};
}

}  // namespace

Result<std::string> to_utf8(std::string text, std::size_t line) {
  if (is_ascii(text)) return text;
  if (text.starts_with("\xFF\xFE") || text.starts_with("\xFE\xFF"))
    return tl::unexpected(Error(fmt::format("{}: is UTF-16; save the file as UTF-8", line)));
  if (text.starts_with("\xEF\xBB\xBF")) text.erase(0, 3);
  if (utf8_until(text) == text.size()) return text;
  std::string out;
  for (std::size_t begin = 0; begin < text.size(); ++line) {
    const std::size_t end = std::min(text.find('\n', begin), text.size() - 1) + 1;
    if (auto ok = append_line(out, std::string_view(text).substr(begin, end - begin)); !ok)
      return tl::unexpected(Error(fmt::format("{}: {}", line, ok.error().message)));
    begin = end;
  }
  return out;
}

std::size_t typing_errors(std::string_view a, std::string_view b) {
  std::vector<std::size_t> before(b.size() + 1), above(b.size() + 1), row(b.size() + 1);
  for (std::size_t j = 0; j < row.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    before = std::exchange(above, row);
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      row[j] = std::min({above[j] + 1, row[j - 1] + 1, above[j - 1] + (a[i - 1] != b[j - 1])});
      const bool swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
      if (swapped) row[j] = std::min(row[j], before[j - 2] + 1);
    }
  }
  return row.back();
}

std::string_view nearest(std::string_view wrong, std::span<const std::string_view> accepted) {
  return *std::ranges::min_element(accepted, {}, [&](std::string_view name) { return typing_errors(wrong, name); });
}

std::string without_controls(std::string text) {
  const auto is_control = [](char c) { return (byte_of(c) < 0x20 && c != '\n' && c != '\t') || byte_of(c) == 0x7F; };
  if (std::ranges::none_of(text, is_control)) return text;
  std::string out;
  for (const char c : text) out += is_control(c) ? fmt::format("\\x{:02x}", byte_of(c)) : std::string(1, c);
  return out;
}

}  // namespace tribotwin
