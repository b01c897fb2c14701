#pragma once

#include <cstdint>

/// Identifiers of CANopen frames (CiA 301, 7.3.5: pre-defined connection set): a function code plus the node number,
/// and the flag bits of the objects that hold one (COB-ID entries).
namespace tribotwin::hil::cob {

constexpr std::uint32_t nmt = 0x000;
constexpr std::uint32_t sync = 0x080;
constexpr std::uint32_t time_stamp = 0x100;
constexpr std::uint32_t emcy = 0x080;           ///< + node
constexpr std::uint32_t sdo_to_server = 0x600;  ///< + node
constexpr std::uint32_t sdo_to_client = 0x580;  ///< + node
constexpr std::uint32_t heartbeat = 0x700;      ///< + node
constexpr std::uint32_t lss_to_slave = 0x7E5, lss_to_master = 0x7E4;

/// Of the n-th PDO, n = 0..3, + node. The fifth has no identifier of its own.
constexpr std::uint32_t rpdo(int n) { return 0x200U + 0x100U * static_cast<std::uint32_t>(n); }
constexpr std::uint32_t tpdo(int n) { return 0x180U + 0x100U * static_cast<std::uint32_t>(n); }
/// Identifiers that no configurable service may have (CiA 301, 7.3.5: restricted CAN-IDs), nor what is longer than 11
/// bits.
constexpr bool restricted(std::uint32_t id) {
  return id <= 0x07F || (id >= 0x101 && id <= 0x180) || (id >= 0x581 && id <= 0x5FF) || (id >= 0x601 && id <= 0x67F) ||
         (id >= 0x6E0 && id <= 0x6FF) || id >= 0x701;
}

constexpr std::uint32_t consumes = 0x80000000, produces = 0x40000000;  ///< of TIME (1012h)
constexpr std::uint32_t off = 0x80000000;                              ///< the service does not exist
constexpr std::uint32_t no_rtr = 0x40000000;                           ///< remote frames are not answered
constexpr std::uint32_t extended = 0x20000000;                         ///< 29-bit identifier
constexpr std::uint32_t id_11_bit = 0x7ff, id_29_bit = 0x1fffffff;

}  // namespace tribotwin::hil::cob
