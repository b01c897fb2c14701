#include <boost/crc.hpp>

#include <tribotwin/twin/io/checksum.hpp>

namespace tribotwin::twin {

namespace {

/// Boost takes the state of a checksum with its bits in the other order.
std::uint32_t reversed(std::uint32_t bits) {
  std::uint32_t out = 0;
  for (int i = 0; i < 32; ++i, bits >>= 1) out = out << 1 | (bits & 1);
  return out;
}

}  // namespace

std::uint32_t crc32(std::string_view bytes, std::uint32_t before) {
  boost::crc_32_type crc(reversed(~before));
  crc.process_bytes(bytes.data(), bytes.size());
  return crc.checksum();
}

}  // namespace tribotwin::twin
