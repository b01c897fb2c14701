#pragma once

#include <cstdint>
#include <random>

/// Internal to this folder, not installed.
namespace tribotwin::twin {

enum Purpose : std::uint64_t { for_sensors = 1, for_levels = 2, for_conditions = 3 };

/// A reproducible stream for one purpose of one curve or series.
inline std::mt19937_64 random_for(std::uint64_t seed, std::uint64_t number, Purpose purpose) {
  std::seed_seq sequence{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32),
                         static_cast<std::uint32_t>(number), static_cast<std::uint32_t>(purpose)};
  return std::mt19937_64(sequence);
}

}  // namespace tribotwin::twin
