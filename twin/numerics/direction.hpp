#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace tribotwin::twin::identification {

/// Which way something slides, sample by sample.
struct Sliding {
  std::vector<double> direction;  ///< 1 or -1; in a rest on the straight line from the direction before it to that
                                  ///< after it, 0 where there is none
  std::vector<bool> rest;
};

/// From equidistant samples of the speed. A rest is where |speed| stays below `slow` for more than `longest_turn`
/// samples: noise about standstill is no motion. In a shorter turn the direction changes once, where the speed does (in
/// the middle of its crossings, where there are several), or not at all where it leaves as it came. `slow` > 0.
Sliding sliding_of(std::span<const double> speed, double slow, std::size_t longest_turn);

/// Whether there is a true one at most `reach` samples away.
std::vector<bool> widened(const std::vector<bool>& signal, std::size_t reach);

}  // namespace tribotwin::twin::identification
