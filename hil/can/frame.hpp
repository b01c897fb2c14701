#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>

namespace tribotwin::hil {

/// A CAN frame, classic or FD.
struct Frame {
  std::uint32_t id = 0;  ///< 11 bit, or 29 bit if extended; the error class of an error frame
  bool extended = false, remote = false, error = false;
  bool fd = false, bit_rate_switch = false, error_passive = false;  ///< FD: format, BRS and ESI bits
  std::uint8_t size = 0;  ///< data bytes: 0..8, FD also 12, 16, 20, 24, 32, 48, 64; of a remote frame: those asked for
  std::array<std::uint8_t, 64> data{};
  std::int64_t time_ns = 0;  ///< when it was on the bus: CLOCK_REALTIME, or the time of a log; not part of equality

  std::span<const std::uint8_t> bytes() const { return {data.data(), size}; }
  bool operator==(const Frame& other) const;
};

/// A classic data frame with an 11-bit identifier.
Frame classic(std::uint32_t id, std::span<const std::uint8_t> bytes);

/// Whether `size` is a length that a frame of its format can have.
bool valid_size(bool fd, std::uint8_t size);

/// As candump writes it: "601#4041600000000000", "123##1AABB" (FD flags), "12345678#R8", "20000088#..." (error frame).
std::string text(const Frame& frame);

/// Bits on the wire of a classic frame of `size` data bytes with an 11-bit identifier, inter-frame space included: with
/// the minimum and the maximum of stuff bits (ISO 11898-1).
struct Bits {
  int min, max;
};
Bits classic_bits(int size);
/// The same of an FD frame whose data phase is five times as fast (1 and 5 Mbit/s), in bits of the slower rate, rounded
/// up (ISO 11898-1:2015).
Bits fd_bits(int size);
/// Of this frame; 0 of an error frame.
Bits bits_of(const Frame& frame);

}  // namespace tribotwin::hil
