#include <algorithm>
#include <cmath>

#include <tribotwin/twin/simulation/multirate.hpp>

namespace tribotwin::twin {

CycleStart::CycleStart(const Twin& twin) : sums(twin.sums()) {
  for (std::size_t i = 0; i < twin.model().drives().size(); ++i) {
    rise.push_back(twin.state(i).rise);
    heat_J.push_back(twin.drive(i).heat_J);
  }
}

CycleExtrapolation::CycleExtrapolation(const Scenario& scenario, std::int64_t cycle_steps)
    : scenario_(scenario), cycle_s_(static_cast<double>(cycle_steps) * scenario.model->get()->opt.timestep) {}

double CycleExtrapolation::keep(std::size_t drive, std::size_t node) const {
  return std::exp(-cycle_s_ / scenario_.model->drives()[drive].drive.thermal.t_s[node]);
}

CycleMap CycleExtrapolation::map(const Twin& twin, const CycleStart& before) const {
  CycleMap map;
  map.sums = twin.sums();
  for (std::size_t i = 0; i < before.sums.size(); ++i) map.sums[i] -= before.sums[i];
  for (std::size_t i = 0; i < before.rise.size(); ++i) {
    map.heat_J.push_back(twin.drive(i).heat_J - before.heat_J[i]);
    auto& input = map.input.emplace_back();
    for (std::size_t n = 0; n < 2; ++n) input[n] = twin.state(i).rise.node_K[n] - keep(i, n) * before.rise[i].node_K[n];
  }
  return map;
}

thermal::Rise CycleExtrapolation::ahead(std::size_t drive, thermal::Rise rise, const CycleMap& from, const CycleMap& to,
                                        std::int64_t count, std::int64_t span,
                                        const std::function<void(std::int64_t, const thermal::Rise&)>& each) const {
  if (scenario_.model->drives()[drive].drive.thermal.order == thermal::Order::prescribed) return rise;
  const double k[2] = {keep(drive, 0), keep(drive, 1)};
  for (std::int64_t c = 1; c <= count; ++c) {
    const double w = static_cast<double>(c) / static_cast<double>(span);
    for (std::size_t n = 0; n < 2; ++n)
      rise.node_K[n] = k[n] * rise.node_K[n] + (1 - w) * from.input[drive][n] + w * to.input[drive][n];
    if (each) each(c, rise);
  }
  return rise;
}

std::int64_t CycleExtrapolation::cycles_within(const Twin& twin, const CycleMap& map, std::size_t i,
                                               std::int64_t count) const {
  const auto& drive = scenario_.model->drives()[i].drive;
  if (drive.thermal.order == thermal::Order::prescribed) return count;
  const double T = twin.temperature_degC(i), base = drive.thermal.T_amb_degC;
  double low = T - scenario_.multirate.tolerance_K, high = T + scenario_.multirate.tolerance_K;
  if (drive.law.info->temperature_dependent)
    for (const double edge : {drive.law.range.temperature_min_degC, drive.law.range.temperature_max_degC}) {
      if (edge > T) high = std::min(high, edge);
      if (edge < T) low = std::max(low, edge);
    }
  std::int64_t allowed = 0;
  bool inside = true;
  // Temperatures of one map are monotone but for a short start; the walk stops at the first cycle outside.
  ahead(i, twin.state(i).rise, map, map, count, 1, [&](std::int64_t c, const thermal::Rise& rise) {
    const double t = base + rise.total_K();
    inside = inside && t >= low && t <= high;
    if (inside) allowed = c;
  });
  return std::min(count, allowed);
}

std::int64_t CycleExtrapolation::cycles_to_skip(const Twin& twin, const CycleMap& map) const {
  const double until_s = std::min({scenario_.duration_s, twin.next_event_s(), twin.time_s() + twin.growth_horizon_s()});
  std::int64_t count = static_cast<std::int64_t>((until_s - twin.time_s()) / cycle_s_ - 1 + 1e-9);
  count = std::clamp<std::int64_t>(count, 0, 100000);
  for (std::size_t i = 0; i < map.heat_J.size() && count > 0; ++i) count = cycles_within(twin, map, i, count);
  return count;
}

}  // namespace tribotwin::twin
