#include <tribotwin/twin/identification/samples.hpp>

namespace tribotwin::twin::identification {

Samples Samples::subset(std::span<const std::size_t> rows) const {
  Samples some;
  const auto take = [&](auto& to, const auto& from) {
    if (from.empty()) return;
    to.reserve(rows.size());
    for (const std::size_t i : rows) to.push_back(from[i]);
  };
  take(some.speed, speed);
  take(some.load, load);
  take(some.temperature_degC, temperature_degC);
  take(some.friction, friction);
  take(some.standard_error, standard_error);
  // Curves keep their order but count from 0 again.
  std::uint32_t next = 0;
  for (std::size_t k = 0; k < rows.size() && !curve.empty(); ++k) {
    if (k && curve[rows[k]] != curve[rows[k - 1]]) ++next;
    some.curve.push_back(next);
  }
  return some;
}

}  // namespace tribotwin::twin::identification
