#pragma once

#include <bit>
#include <concepts>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>

/// Private to this folder: the little-endian numbers and length-prefixed texts that MCAP records are made of.
namespace tribotwin::twin::mcap {

static_assert(std::endian::native == std::endian::little);

/// Takes a byte sequence apart. What lies beyond its end reads as zero or empty, and whole() is false from then on.
class Cursor {
 public:
  explicit Cursor(std::string_view bytes) : rest_(bytes) {}

  template <std::unsigned_integral T>
  T number() {
    T value = 0;
    const auto taken = bytes(sizeof value);
    if (whole_) std::memcpy(&value, taken.data(), sizeof value);
    return value;
  }
  std::string_view bytes(std::uint64_t count) {
    whole_ = whole_ && count <= rest_.size();
    if (!whole_) return {};
    const auto taken = rest_.substr(0, count);
    rest_.remove_prefix(count);
    return taken;
  }
  /// Behind a length of 32 bits.
  std::string_view text() { return bytes(number<std::uint32_t>()); }
  std::string_view rest() const { return rest_; }
  bool whole() const { return whole_; }

 private:
  std::string_view rest_;
  bool whole_ = true;
};

template <std::unsigned_integral T>
void put(std::string& out, T value) {
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}
inline void put_text(std::string& out, std::string_view text) {
  put(out, static_cast<std::uint32_t>(text.size()));
  out += text;
}

/// Operation codes of records, specification 1.0.
enum class Op : std::uint8_t {
  header = 1,
  footer,
  schema,
  channel,
  message,
  chunk,
  message_index,
  chunk_index,
  attachment,
  attachment_index,
  statistics,
  metadata,
  metadata_index,
  summary_offset,
  data_end
};
constexpr std::string_view magic("\x89MCAP0\r\n", 8);
constexpr std::size_t record_head = 9;  ///< bytes before the content of a record: operation code and length

}  // namespace tribotwin::twin::mcap
