#include <boost/crc.hpp>

#include <tribotwin/twin/io/checksum.hpp>

namespace tribotwin::twin {

std::uint32_t crc32(std::string_view bytes) {
  boost::crc_32_type crc;
  crc.process_bytes(bytes.data(), bytes.size());
  return crc.checksum();
}

}  // namespace tribotwin::twin
