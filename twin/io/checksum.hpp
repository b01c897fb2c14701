#pragma once

#include <cstdint>
#include <string_view>

namespace tribotwin::twin {

/// CRC-32 (ISO 3309, as of zip and PNG): finds accidental changes of a file, not malicious ones.
std::uint32_t crc32(std::string_view bytes);

}  // namespace tribotwin::twin
