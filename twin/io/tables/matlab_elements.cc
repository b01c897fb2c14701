#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <fstream>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/twin/io/tables/source.hpp>

namespace tribotwin::twin::tables {
namespace {

/// Whole numbers of a file at its current place, in either order of bytes.
class Words {
 public:
  explicit Words(std::ifstream& stream) : stream_(stream) {}
  bool swapped = false;

  /// false at the end of the file, also in the middle of the numbers.
  template <std::size_t count>
  bool read(std::array<std::uint32_t, count>& words) {
    stream_.read(reinterpret_cast<char*>(words.data()), sizeof words);
    if (swapped)
      for (auto& word : words) word = __builtin_bswap32(word);
    return stream_.good();
  }

 private:
  std::ifstream& stream_;
};

/// The length of the variable that begins here with its head; nothing where the head itself is cut off or is none.
using Length = std::optional<std::uintmax_t> (*)(Words&);

std::optional<std::uintmax_t> length_v5(Words& words) {
  std::array<std::uint32_t, 2> tag;  // type, bytes
  if (!words.read(tag)) return std::nullopt;
  return sizeof tag + std::uintmax_t{tag[1]};
}

std::optional<std::uintmax_t> length_v4(Words& words) {
  std::array<std::uint32_t, 5> head;  // type, rows, columns, complex, bytes of the name
  if (!words.read(head)) return std::nullopt;
  constexpr std::uintmax_t number_bytes[] = {8, 4, 4, 2, 2, 1};
  const std::uint32_t precision = head[0] / 10 % 10;
  if (precision >= std::size(number_bytes)) return std::nullopt;
  std::uintmax_t numbers = head[1];
  if (__builtin_mul_overflow(numbers, std::uintmax_t{head[2]}, &numbers) || numbers >> 56) return std::nullopt;
  return sizeof head + head[4] + numbers * number_bytes[precision] * (head[3] ? 2 : 1);
}

std::optional<std::string> walk(std::ifstream& stream, Words& words, std::uintmax_t at, std::uintmax_t size,
                                Length length) {
  for (std::size_t count = 1; at < size; ++count) {
    if (count > limits::matlab_variables)
      return fmt::format("holds more than {} variables, the most that are read", limits::matlab_variables);
    stream.seekg(static_cast<std::streamoff>(at));
    const auto bytes = length(words);
    if (!bytes || *bytes > size - at)
      return fmt::format(
          "is cut off or damaged: variable {} begins at byte {} and needs {} more than the file has; copy or save it "
          "again",
          count, at, bytes ? fmt::format("{} bytes", *bytes - (size - at)) : "bytes");
    at += *bytes;
  }
  return std::nullopt;
}

}  // namespace

std::optional<std::string> cut_off(const std::filesystem::path& file) {
  std::error_code error;
  const auto size = std::filesystem::file_size(file, error);
  std::ifstream stream(file, std::ios::binary);
  std::array<char, 128> head{};
  stream.read(head.data(), head.size());
  const auto got = static_cast<std::size_t>(stream.gcount());
  stream.clear();
  if (error || got < 20) return std::nullopt;
  Words words(stream);
  // Version 5 begins with text; the first number of version 4 has a byte of 0.
  if (std::find(head.begin(), head.begin() + 4, '\0') != head.begin() + 4) {
    std::uint32_t type;
    std::memcpy(&type, head.data(), sizeof type);
    words.swapped = type > 4052;
    return walk(stream, words, 0, size, length_v4);
  }
  constexpr std::size_t version_at = 124, order_at = 126;
  const bool big = head[order_at] == 'M' && head[order_at + 1] == 'I',
             little = head[order_at] == 'I' && head[order_at + 1] == 'M';
  if (got < head.size() || (!big && !little) || head[version_at + (big ? 0 : 1)] != 1) return std::nullopt;
  words.swapped = big == (std::endian::native == std::endian::little);
  return walk(stream, words, head.size(), size, length_v5);
}

}  // namespace tribotwin::twin::tables
