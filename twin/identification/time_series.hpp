#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>

/// Recordings sample by sample, for models with a state.
namespace tribotwin::twin::identification {

/// A step longer than this many typical ones is a gap: nothing is filtered or differentiated across it.
constexpr double gap_steps = 2.5;

/// The columns `needed`, of which the first is time_s, then those of `optional` (empty where the file has none). Time
/// must increase from row to row. Rows with a cell that is no finite number are left out, with a note. ErrorKind::input
/// with file and what would be right.
Result<Numbers> read_time_series(const std::filesystem::path& file, const std::vector<std::string>& needed,
                                 const std::vector<std::string>& optional, std::vector<std::string>& notes,
                                 const TableOptions& options = {});

/// Why a column is implausible as the temperature of a gearbox: outside -60 .. 250 degC.
std::optional<std::string> implausible_temperature(const std::filesystem::path& file, std::string_view column,
                                                   std::span<const double> degC);

/// Where no joint is faster [rad/s; m/s] it rests: what is left is creep, tremble of its servo and noise.
constexpr double standstill_rad_s = 1e-2;

/// A recorded velocity over the slope of the position, by least squares, with the scatter as sigma.
struct VelocityRatio {
  double value, sigma;
  /// Whether it is proven to be no velocity of this position: beyond a factor of two.
  bool contradicts() const { return value + 3 * sigma < 0.5 || value - 3 * sigma > 2; }
  /// "is 57.3 +- 0.1 times the slope of position_rad: one of them is in degrees"
  std::string text(std::string_view position) const;
};

/// Position and the integral of the velocity are compared over a time in which the joint moves much farther than from
/// sample to sample, where noise may exceed its motion; at most an eighth of the samples. Steps beyond `gap_steps`
/// typical ones are left out. Nothing where the joint rests, or moves no farther in that time than from sample to
/// sample: there noise would be compared, which still draws the ratio towards 0 by up to a quarter. All of one length;
/// rad, rad/s or m, m/s.
std::optional<VelocityRatio> velocity_over_slope(std::span<const double> time_s, std::span<const double> position,
                                                 std::span<const double> velocity);

}  // namespace tribotwin::twin::identification
