#pragma once

#include <random>
#include <string>
#include <vector>

#include <tribotwin/twin/io/input.hpp>

/// Internal to this folder, not installed.
namespace tribotwin::twin {

inline constexpr std::size_t max_curves = 100000;

/// The values of a quantity in a series, or a range to draw from.
struct Axis {
  std::vector<double> values;
  double low = 0, high = 0;
  bool range = false;

  double draw(std::mt19937_64& random) const;
};

/// A number, a list, or {from, to, count, spacing}; where `drawn`, the count is optional. For readers: throws
/// InputError.
Axis read_axis(Mapping& in, const std::string& key, Bounds bounds, bool drawn);

}  // namespace tribotwin::twin
