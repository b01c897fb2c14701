#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include <tribotwin/twin/simulation/twin.hpp>

/// Multi-rate simulation. One work cycle, computed in full, is an affine map of each thermal node: rise' = keep rise +
/// input, where `input` depends on the temperature only slowly. Cycles ahead follow from that map in closed form until
/// they would leave the tolerance. Then the next cycle is computed in full, and the skipped cycles between are
/// corrected with the interpolated input (trapezoid). Heat and what else adds up in a skipped cycle are
/// interpolated likewise, so that sums and shares over a run do not depend on which cycles were computed.
namespace tribotwin::twin {

struct CycleMap {
  std::vector<std::array<double, 2>> input;  ///< per drive and thermal node [K]
  std::vector<double> heat_J;                ///< per drive
  std::vector<double> sums;                  ///< Twin::sums over the cycle's steps
};

/// What a twin has summed up so far.
struct CycleStart {
  explicit CycleStart(const Twin& twin);
  std::vector<thermal::Rise> rise;
  std::vector<double> heat_J;  ///< per drive
  std::vector<double> sums;
};

class CycleExtrapolation {
 public:
  CycleExtrapolation(const Scenario& scenario, std::int64_t cycle_steps);

  /// The map of the cycle that led from `before` to the twin's state.
  CycleMap map(const Twin& twin, const CycleStart& before) const;

  /// Rise of a drive after each of `count` cycles from `rise`; its input changes linearly from that of `from` to that
  /// of `to`, which is `span` cycles ahead. Calls `each` with number and rise.
  thermal::Rise ahead(std::size_t drive, thermal::Rise rise, const CycleMap& from, const CycleMap& to,
                      std::int64_t count, std::int64_t span,
                      const std::function<void(std::int64_t, const thermal::Rise&)>& each) const;

  /// Number of cycles that may be skipped: none may change a temperature by more than the tolerance, cross the edge of
  /// a law's range, an event or the end, nor may a fault grow much. The last cycle is always computed.
  std::int64_t cycles_to_skip(const Twin& twin, const CycleMap& map) const;

  /// Share of a node's rise that is left after one cycle.
  double keep(std::size_t drive, std::size_t node) const;

 private:
  std::int64_t cycles_within(const Twin& twin, const CycleMap& map, std::size_t drive, std::int64_t count) const;

  const Scenario& scenario_;
  double cycle_s_;
};

}  // namespace tribotwin::twin
