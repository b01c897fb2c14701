#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include <tribotwin/twin/identification/time_series.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/median.hpp>

namespace tribotwin::twin::identification {
namespace {

constexpr double degrees_per_rad = 180 / std::numbers::pi;

/// Positions, the integral of the velocity, and how many gaps came before, per sample.
struct Travel {
  std::span<const double> time_s, position;
  std::vector<double> integral;
  std::vector<std::size_t> gaps;
};

Travel travel_of(std::span<const double> time_s, std::span<const double> position, std::span<const double> velocity) {
  Travel out{.time_s = time_s, .position = position, .integral = {0}, .gaps = {0}};
  const double longest = gap_steps * median_step(time_s);
  for (std::size_t i = 1; i < time_s.size(); ++i) {
    const double step = time_s[i] - time_s[i - 1];
    out.integral.push_back(out.integral.back() + 0.5 * (velocity[i] + velocity[i - 1]) * step);
    out.gaps.push_back(out.gaps.back() + (step > longest));
  }
  return out;
}

/// Sums over pairs of samples `apart`, none across a gap. x: way by the positions, y: by the velocities.
struct Ways {
  double count = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0, fastest = 0;
  double mean_square() const { return count > 0 ? xx / count : 0; }
};

Ways ways_of(const Travel& travel, std::size_t apart) {
  Ways w;
  for (std::size_t i = apart; i < travel.position.size(); ++i) {
    if (travel.gaps[i] != travel.gaps[i - apart]) continue;
    const double x = travel.position[i] - travel.position[i - apart],
                 y = travel.integral[i] - travel.integral[i - apart];
    ++w.count, w.x += x, w.y += y, w.xx += x * x, w.xy += x * y, w.yy += y * y;
    w.fastest = std::max(w.fastest, std::abs(x) / (travel.time_s[i] - travel.time_s[i - apart]));
  }
  return w;
}

}  // namespace

Result<Numbers> read_time_series(const std::filesystem::path& file, const std::vector<std::string>& needed,
                                 const std::vector<std::string>& optional, std::vector<std::string>& notes,
                                 const TableOptions& options) {
  std::vector<std::string> wanted = needed;
  wanted.insert(wanted.end(), optional.begin(), optional.end());
  auto table = read_numbers(file, wanted, options);
  if (!table) return table;
  for (const auto& name : needed)
    if (!table->has(name))
      return tl::unexpected(fmt::format("{}:1: no column {}; {}the columns are {}, and may be {}; the header names {}",
                                        file.string(), name, table->hint(name), joined(needed), joined(optional),
                                        table->header));
  notes.insert(notes.end(), table->notes.begin(), table->notes.end());
  const auto& time = table->columns[0];
  if (time.empty())
    return tl::unexpected(table->left_out
                              ? fmt::format("{}: no row without an empty, NaN or infinite cell", file.string())
                              : fmt::format("{}: is empty: a header but no samples", file.string()));
  if (const auto problem = not_increasing(*table, time)) return tl::unexpected(*problem);
  if (3 * table->left_out > time.size() + table->left_out)
    return tl::unexpected(fmt::format("{}: {} of {} rows hold no finite numbers; too few are left for a recording",
                                      file.string(), table->left_out, time.size() + table->left_out));
  if (table->left_out)
    notes.push_back(fmt::format("{}: {} rows with empty, NaN or infinite cells are left out, the first in {} {}",
                                file.string(), table->left_out, table->row, table->first_left_out));
  return table;
}

std::string VelocityRatio::text(std::string_view position) const {
  const double size = std::abs(std::log(std::abs(value)));
  return fmt::format("is {:.3g} +- {:.1g} times the slope of {}{}", value, sigma, position,
                     std::abs(size - std::log(degrees_per_rad)) < 0.3 ? ": one of them is in degrees"
                                                                      : "; one of them is not what its name says");
}

std::optional<VelocityRatio> velocity_over_slope(std::span<const double> time_s, std::span<const double> position,
                                                 std::span<const double> velocity) {
  constexpr double farther = 4, much_farther = 16;  // mean square, than from sample to sample
  if (time_s.size() < 3) return {};
  const Travel travel = travel_of(time_s, position, velocity);
  const double step = ways_of(travel, 1).mean_square();
  Ways best, farthest;
  std::size_t apart = 1;
  for (std::size_t k = 1; k <= std::max<std::size_t>(2, time_s.size() / 8); k *= 2) {
    const Ways w = ways_of(travel, k);
    if (w.mean_square() > best.mean_square() && !(best.mean_square() > much_farther * step)) best = w, apart = k;
    if (w.mean_square() > farthest.mean_square()) farthest = w;
  }
  if (!(best.mean_square() > farther * step) || farthest.fastest < standstill_rad_s) return {};
  // About the means: an offset of the velocity is none of its scale.
  const double xx = best.xx - best.x * best.x / best.count, xy = best.xy - best.x * best.y / best.count,
               yy = best.yy - best.y * best.y / best.count;
  if (!(xx > 0)) return {};
  const double value = xy / xx, independent = std::max(1.0, best.count / static_cast<double>(apart) - 2);
  return VelocityRatio{.value = value, .sigma = std::sqrt(std::max(0.0, yy / xx - value * value) / independent)};
}

std::optional<std::string> implausible_temperature(const std::filesystem::path& file, std::string_view column,
                                                   std::span<const double> degC) {
  constexpr double minimum = -60, maximum = 250;
  if (degC.empty()) return {};
  const auto [low, high] = std::ranges::minmax(degC);
  if (low >= minimum && high <= maximum) return {};
  return fmt::format(
      "{}: {} goes from {:.4g} to {:.4g}, where a gearbox is between {:g} and {:g}; are these kelvins, or is it "
      "another column?",
      file.string(), column, low, high, minimum, maximum);
}

}  // namespace tribotwin::twin::identification
