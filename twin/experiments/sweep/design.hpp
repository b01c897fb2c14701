#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

/// Where a sweep looks: points of a unit cube that stand for the values of its factors.
namespace tribotwin::twin::sweep {

enum class DesignType { grid, latin_hypercube, sobol, random };

/// The names in a plan.
inline constexpr std::pair<const char*, DesignType> design_types[] = {{"grid", DesignType::grid},
                                                                      {"latin_hypercube", DesignType::latin_hypercube},
                                                                      {"sobol", DesignType::sobol},
                                                                      {"random", DesignType::random}};

/// The most dimensions that Sobol' points can have: the direction numbers of Boost.Random (Joe, Kuo 2008).
std::size_t sobol_dimensions();

/// `points` points of (0, 1)^dimensions, one after the other. Not for a grid.
///
/// random: independent and uniform. latin_hypercube: each of the `points` equal slices of each dimension holds one
/// point (McKay 1979). sobol: Sobol' sequence from its first point (0), moved by a random digital shift, which keeps
/// the number of points in every elementary interval; every beginning of the sequence is a Sobol' set too.
/// The same seed gives the same points, of random and sobol also where more of them are asked for.
std::vector<double> unit_points(DesignType type, std::size_t points, std::size_t dimensions, std::uint64_t seed);

/// The runs of a design by Saltelli (2010): for each base point a row of A, one of B, and for each of the `groups` the
/// row of A with the values of one group from B. `column_group`: the group of each dimension of A.
struct Saltelli {
  std::size_t base_points = 0;
  std::vector<std::size_t> column_group;

  std::size_t groups() const;
  std::size_t block() const { return groups() + 2; }  ///< runs per base point
  /// Whether the run is a row of A or B, which are independent of each other.
  bool independent(std::size_t run) const { return run % block() < 2; }
  /// The point of a run. `ab`: base_points points of (0, 1)^(2 dimensions), A in front of B.
  std::vector<double> point(const std::vector<double>& ab, std::size_t run) const;
};

}  // namespace tribotwin::twin::sweep
