#pragma once

#include <span>
#include <string>
#include <vector>

#include <tribotwin/hil/can/frame.hpp>
#include <tribotwin/hil/canopen/dbc.hpp>

namespace tribotwin::hil {

/// Load of one classic bus by a configuration, without a simulation.
struct Budget {
  double cycle_s;
  int frames;               ///< per cycle
  double min, max;          ///< share of the bus, with the minimum and the maximum of stuff bits
  double shortest_cycle_s;  ///< at 80 % of the worst load
  std::string line() const;
};

/// Of SYNC and all synchronous PDOs, by their transmission types. bit_rate [bit/s].
Budget budget(std::span<const DescribedDrive> drives, double cycle_s, double bit_rate);
/// Of SYNC and, for every drive, these frames. FD frames count at the slower bit rate.
Budget budget_of_frames(int drives, std::span<const Bits> of_each, double cycle_s, double bit_rate);

}  // namespace tribotwin::hil
