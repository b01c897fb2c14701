#pragma once

#include <optional>

#include <tribotwin/hil/can/frame.hpp>

namespace tribotwin::hil {

/// A number in a frame's data: as DBC files and PDO mappings describe it.
struct Signal {
  enum class Kind { is_unsigned, is_signed, is_float };

  /// Little-endian: of the lowest bit. Big-endian: of the highest bit. Bit b is bit b % 8 (0: lowest) of byte b / 8.
  int start = 0;
  int bits = 8;  ///< 1..64; a float has 32 or 64
  bool big_endian = false;
  Kind kind = Kind::is_unsigned;
  double factor = 1, offset = 0;

  /// Number of bytes that a frame must have to hold it; -1 where it begins before the first byte.
  int bytes() const;
  /// The bits as an unsigned number; none where the frame is too short.
  std::optional<std::uint64_t> raw(const Frame& frame) const;
  /// factor x number + offset; none where the frame is too short, or for a float that is no finite number.
  std::optional<double> value(const Frame& frame) const;
};

}  // namespace tribotwin::hil
