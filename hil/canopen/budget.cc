#include <fmt/format.h>

#include <tribotwin/hil/can/frame.hpp>
#include <tribotwin/hil/canopen/budget.hpp>

namespace tribotwin::hil {

Budget budget(std::span<const DescribedDrive> drives, double cycle_s, double bit_rate) {
  double least = classic_bits(0).least, most = classic_bits(0).most;
  int frames = 1;
  for (const auto& d : drives)
    for (const int base : {0x1400, 0x1800})
      for (int i = 0; i < pdo_count; ++i) {
        const auto at = static_cast<std::uint16_t>(base + i), map = static_cast<std::uint16_t>(at + 0x200);
        const auto type = d.dictionary->get(at, 2);
        if (d.dictionary->get(at, 1) & 0x80000000 || type > 240) continue;
        int bits = 0;
        for (std::uint8_t k = 1; k <= d.dictionary->get(map, 0); ++k)
          bits += static_cast<int>(d.dictionary->get(map, k) & 0xff);
        // Sent by the master every cycle; by the drive every type-th, and type 0 at most every.
        const double per_cycle = base == 0x1800 && type > 1 ? 1.0 / static_cast<double>(type) : 1;
        const Bits b = classic_bits(bits / 8);
        least += per_cycle * b.least;
        most += per_cycle * b.most;
        ++frames;
      }
  return {cycle_s, frames, least / (bit_rate * cycle_s), most / (bit_rate * cycle_s), most / (0.8 * bit_rate)};
}

Budget budget_of_frames(int drives, double cycle_s, double bit_rate) {
  const double least = classic_bits(0).least + 2.0 * drives * classic_bits(8).least,
               most = classic_bits(0).most + 2.0 * drives * classic_bits(8).most;
  return {cycle_s, 1 + 2 * drives, least / (bit_rate * cycle_s), most / (bit_rate * cycle_s), most / (0.8 * bit_rate)};
}

std::string Budget::line() const {
  return fmt::format(
      "{} frames per cycle of {:.3g} ms: {:.0f} to {:.0f} % of the bus; shortest cycle at 80 % of the worst load: "
      "{:.2f} ms",
      frames, 1e3 * cycle_s, 100 * least, 100 * most, 1e3 * shortest_cycle_s);
}

}  // namespace tribotwin::hil
