#include <bit>
#include <cmath>

#include <tribotwin/hil/shadow/signal.hpp>

namespace tribotwin::hil {

int Signal::bytes() const {
  if (!big_endian) return (start + bits + 7) / 8;
  const int first_byte_bits = start % 8 + 1, rest = bits - first_byte_bits;
  return start / 8 + 1 + (rest > 0 ? (rest + 7) / 8 : 0);
}

std::optional<std::uint64_t> Signal::raw(const Frame& frame) const {
  if (frame.size < bytes()) return std::nullopt;
  const auto bit = [&](int b) {
    return static_cast<std::uint64_t>(frame.data[static_cast<std::size_t>(b / 8)] >> b % 8 & 1);
  };
  std::uint64_t value = 0;
  for (int i = 0, b = start; i < bits; ++i) {
    if (big_endian) {
      value = value << 1 | bit(b);
      b = b % 8 == 0 ? b + 15 : b - 1;
    } else {
      value |= bit(start + i) << i;
    }
  }
  return value;
}

std::optional<double> Signal::value(const Frame& frame) const {
  const auto unsigned_value = raw(frame);
  if (!unsigned_value) return std::nullopt;
  double number = static_cast<double>(*unsigned_value);
  if (kind == Kind::is_signed && *unsigned_value >> (bits - 1) & 1)
    number =
        static_cast<double>(static_cast<std::int64_t>(bits < 64 ? *unsigned_value - (1ULL << bits) : *unsigned_value));
  if (kind == Kind::is_float)
    number = bits == 32 ? static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(*unsigned_value)))
                        : std::bit_cast<double>(*unsigned_value);
  const double physical = factor * number + offset;
  if (!std::isfinite(physical)) return std::nullopt;
  return physical;
}

}  // namespace tribotwin::hil
