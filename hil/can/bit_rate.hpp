#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>

namespace tribotwin::hil {

/// Bit rate [bit/s] that a CAN interface is set to, of the arbitration phase; none of a virtual one (vcan, vxcan),
/// which has no bit timing, and where there is no such interface.
std::optional<double> bit_rate_of(const std::string& interface);

/// The same from the kernel's answer to RTM_GETLINK (rtnetlink(7)): IFLA_LINKINFO, IFLA_INFO_DATA, IFLA_CAN_BITTIMING.
std::optional<double> bit_rate_in(std::span<const std::byte> answer);

}  // namespace tribotwin::hil
