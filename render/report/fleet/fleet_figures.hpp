#pragma once

#include <optional>

#include <tribotwin/render/page/figure_table.hpp>
#include <tribotwin/render/report/fleet/fleet_report.hpp>

/// The figures of a fleet. Their captions say what was drawn.
namespace tribotwin::render {

constexpr std::size_t rows_of_the_plant = 40, columns_of_the_plant = 12;

/// Coulomb friction of a joint against its healthy level, over days.
std::optional<Drawing> level_over_days(const twin::diagnosis::fleet::Detail& detail, std::int64_t end_s);
/// All features of a joint, in standard deviations of a healthy curve.
std::optional<Drawing> features_over_days(const twin::diagnosis::fleet::Detail& detail, std::int64_t end_s);
/// `since_s`: from which day on the joint is listed.
std::optional<Drawing> cusum_over_days(const twin::diagnosis::fleet::Detail& detail, std::int64_t end_s,
                                       std::optional<std::int64_t> since_s);
/// Robots over joints, coloured by the change of friction: robots with listed joints first, then those that have
/// changed most. Of more joints than columns_of_the_plant all that are listed on a robot, then others up to that
/// number.
std::optional<Drawing> plant_map(const FleetData& data);

}  // namespace tribotwin::render
