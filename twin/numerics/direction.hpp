#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace tribotwin::twin::identification {

/// Which way something slides, sample by sample.
struct Sliding {
  std::vector<double> direction;  ///< 1 or -1; 0 where nothing moves at all
  std::vector<bool> rest;
};

/// From equidistant samples of the speed. It moves where |speed| is at least `slow` in one direction until the speeds
/// add up to `far`; less is noise about standstill, or what is left of a motion that has stopped. A rest is where it
/// does not move for more than `longest_turn` samples. In it, and in a shorter turn, the direction changes once, where
/// the speed does (in the middle of its crossings, where there are several), or not at all where it leaves as it came.
/// In a rest at an end it is that of the motion beside it. `slow` > 0.
Sliding sliding_of(std::span<const double> speed, double slow, double far, std::size_t longest_turn);

/// Whether there is a true one at most `reach` samples away.
std::vector<bool> widened(const std::vector<bool>& signal, std::size_t reach);

}  // namespace tribotwin::twin::identification
