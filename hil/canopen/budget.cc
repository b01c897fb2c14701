#include <fmt/format.h>

#include <tribotwin/hil/can/frame.hpp>
#include <tribotwin/hil/canopen/budget.hpp>
#include <tribotwin/hil/canopen/communication_objects.hpp>

namespace tribotwin::hil {
namespace {

constexpr double usable_load = 0.8;
constexpr int last_synchronous = 240;  // transmission type

/// Adds up the bits of the frames of one cycle.
struct Cycle {
  double min = 0, max = 0;
  int frames = 0;

  void add(int bytes, double per_cycle = 1) { add(classic_bits(bytes), per_cycle); }
  void add(Bits b, double per_cycle = 1) {
    min += per_cycle * b.min;
    max += per_cycle * b.max;
    ++frames;
  }
  Budget over(double cycle_s, double bit_rate) const {
    return {cycle_s, frames, min / (bit_rate * cycle_s), max / (bit_rate * cycle_s), max / (usable_load * bit_rate)};
  }
};

}  // namespace

Budget budget(std::span<const DescribedDrive> drives, double cycle_s, double bit_rate) {
  Cycle cycle;
  cycle.add(0);  // SYNC
  for (const auto& d : drives)
    for (const bool transmit : {false, true})
      for (int i = 0; i < pdo_count; ++i) {
        const auto pdo = pdo_parameters(*d.dictionary, transmit, i);
        if (!pdo.exists || pdo.type > last_synchronous) continue;
        int bits = 0;
        for (const MappingEntry& entry : pdo.map) bits += entry.bits;
        // The master sends every cycle; the drive every type-th, and type 0 at most every cycle.
        cycle.add(bits / 8, transmit && pdo.type > 1 ? 1.0 / pdo.type : 1);
      }
  return cycle.over(cycle_s, bit_rate);
}

Budget budget_of_frames(int drives, std::span<const Bits> of_each, double cycle_s, double bit_rate) {
  Cycle cycle;
  cycle.add(0);  // SYNC
  for (int i = 0; i < drives; ++i)
    for (const Bits& bits : of_each) cycle.add(bits);
  return cycle.over(cycle_s, bit_rate);
}

std::string Budget::line() const {
  return fmt::format(
      "{} frames per cycle of {:.3g} ms: {:.0f} to {:.0f} % of the bus; shortest cycle at 80 % of the worst load: "
      "{:.2f} ms",
      frames, 1e3 * cycle_s, 100 * min, 100 * max, 1e3 * shortest_cycle_s);
}

}  // namespace tribotwin::hil
