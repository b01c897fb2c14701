#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/thermal/thermal_recording.hpp>

/// Internal to this folder, not installed.
namespace tribotwin::twin::identification {

/// The work cycles of a run's record (telemetry.h5, or the folder): mean friction power and final temperature of every
/// cycle, the skipped ones of a multi-rate run included. Nothing where `file` is no record or has fewer than
/// `least_rows`. `cycle_s`: HeatSession::cycle_s and cycle_power_w are filled where above 0.
Result<std::optional<ThermalRecording>> cycle_rows(const std::filesystem::path& file, std::size_t index, double cycle_s,
                                                   std::size_t least_rows);

}  // namespace tribotwin::twin::identification
