#pragma once

#include <cstdint>
#include <string_view>

namespace tribotwin::twin {

/// CRC-32 (ISO 3309, as of zip and PNG): finds accidental changes of a file, not malicious ones. `before` is that of
/// the bytes in front of these.
std::uint32_t crc32(std::string_view bytes, std::uint32_t before = 0);

}  // namespace tribotwin::twin
