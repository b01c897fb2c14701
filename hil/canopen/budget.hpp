#pragma once

#include <string>
#include <vector>

#include <tribotwin/hil/canopen/description.hpp>

namespace tribotwin::hil {

/// What a configuration asks of one classic bus, before anything runs.
struct Budget {
  double cycle_s;
  int frames;               ///< per cycle
  double least, most;       ///< share of the bus, without and with the most stuffing
  double shortest_cycle_s;  ///< at 80 % of the worst load
  std::string line() const;
};

/// SYNC, and of every drive the PDOs that go with each SYNC (by their transmission types).
Budget budget(std::span<const DescribedDrive> drives, double cycle_s, double bit_rate);
/// SYNC, and of every drive 8 bytes each way.
Budget budget_of_frames(int drives, double cycle_s, double bit_rate);

}  // namespace tribotwin::hil
