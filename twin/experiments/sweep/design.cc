#include <algorithm>
#include <random>

#include <boost/random/sobol.hpp>

#include <tribotwin/twin/experiments/sweep/design.hpp>

namespace tribotwin::twin::sweep {
namespace {

enum Purpose : std::uint32_t { for_points = 1, for_order = 2, for_shift = 3 };

/// A reproducible stream for one purpose of one dimension.
std::mt19937_64 stream(std::uint64_t seed, Purpose purpose, std::size_t dimension = 0) {
  std::seed_seq sequence{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32),
                         static_cast<std::uint32_t>(purpose), static_cast<std::uint32_t>(dimension)};
  return std::mt19937_64(sequence);
}

/// The 53 leading bits as a number within (0, 1).
double to_unit(std::uint64_t bits) { return (static_cast<double>(bits >> 12) + 0.5) * 0x1p-52; }

/// The slices of a dimension in random order (Fisher, Yates).
std::vector<std::size_t> shuffled(std::size_t count, std::mt19937_64& random) {
  std::vector<std::size_t> order(count);
  for (std::size_t i = 0; i < count; ++i) order[i] = i;
  for (std::size_t i = count; i > 1; --i)
    std::swap(order[i - 1], order[static_cast<std::size_t>(to_unit(random()) * static_cast<double>(i))]);
  return order;
}

std::vector<double> latin_hypercube(std::size_t points, std::size_t dimensions, std::uint64_t seed) {
  std::vector<double> all(points * dimensions);
  for (std::size_t d = 0; d < dimensions; ++d) {
    auto order = stream(seed, for_order, d), within = stream(seed, for_points, d);
    const auto slices = shuffled(points, order);
    for (std::size_t i = 0; i < points; ++i)
      all[i * dimensions + d] = (static_cast<double>(slices[i]) + to_unit(within())) / static_cast<double>(points);
  }
  return all;
}

std::vector<double> sobol(std::size_t points, std::size_t dimensions, std::uint64_t seed) {
  std::vector<double> all(points * dimensions);
  std::vector<std::uint64_t> shift;
  auto random = stream(seed, for_shift);
  for (std::size_t d = 0; d < dimensions; ++d) shift.push_back(random());
  for (std::size_t d = 0; d < dimensions && points > 0; ++d) all[d] = to_unit(shift[d]);  // of the point 0
  boost::random::sobol engine(dimensions);  // it begins behind the point 0
  for (std::size_t i = 1; i < points; ++i)
    for (std::size_t d = 0; d < dimensions; ++d) all[i * dimensions + d] = to_unit(engine() ^ shift[d]);
  return all;
}

}  // namespace

std::size_t sobol_dimensions() { return boost::random::default_sobol_table::max_dimension; }

std::vector<double> unit_points(DesignType type, std::size_t points, std::size_t dimensions, std::uint64_t seed) {
  if (type == DesignType::latin_hypercube) return latin_hypercube(points, dimensions, seed);
  if (type == DesignType::sobol && dimensions > 0) return sobol(points, dimensions, seed);
  std::vector<double> all(points * dimensions);
  auto random = stream(seed, for_points);
  for (double& u : all) u = to_unit(random());
  return all;
}

std::size_t Saltelli::groups() const { return column_group.empty() ? 0 : *std::ranges::max_element(column_group) + 1; }

std::vector<double> Saltelli::point(const std::vector<double>& ab, std::size_t run) const {
  const std::size_t dimensions = column_group.size(), row = run / block() * 2 * dimensions, kind = run % block();
  std::vector<double> u(dimensions);
  for (std::size_t d = 0; d < dimensions; ++d) {
    const bool of_b = kind == 1 || (kind >= 2 && column_group[d] == kind - 2);
    u[d] = ab[row + d + (of_b ? dimensions : 0)];
  }
  return u;
}

}  // namespace tribotwin::twin::sweep
