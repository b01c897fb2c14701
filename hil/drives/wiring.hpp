#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

namespace tribotwin::hil {

/// The drives on each bus of a robot: by their places in the robot (0 is the first), in the order of their node
/// numbers. Empty: all on one bus.
using Wiring = std::vector<std::vector<std::size_t>>;

/// The bus of a drive, and its place on it.
struct Place {
  std::size_t bus, rank;
};

inline std::size_t bus_count(const Wiring& wiring) { return std::max<std::size_t>(1, wiring.size()); }

/// `drive` is on one of the buses.
inline Place place_of(const Wiring& wiring, std::size_t drive) {
  for (std::size_t bus = 0; bus < wiring.size(); ++bus)
    for (std::size_t rank = 0; rank < wiring[bus].size(); ++rank)
      if (wiring[bus][rank] == drive) return {bus, rank};
  return {0, drive};
}

/// Whether each of so many drives is on one bus, and no other.
inline bool wires_all(const Wiring& wiring, std::size_t drives) {
  std::vector<int> times(drives);
  std::size_t all = 0;
  for (const auto& bus : wiring)
    for (const std::size_t drive : bus) {
      ++all;
      if (drive < drives) ++times[drive];
    }
  return wiring.empty() || (all == drives && std::ranges::all_of(times, [](int t) { return t == 1; }));
}

/// Name of a bus in logs and statistics: can0, can1.
inline std::string channel_of(std::size_t bus) { return "can" + std::to_string(bus); }

}  // namespace tribotwin::hil
