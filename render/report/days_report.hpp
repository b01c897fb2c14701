#pragma once

#include <filesystem>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/render/page/illustrated.hpp>
#include <tribotwin/twin/experiments/working_days/results.hpp>

namespace tribotwin::render {

/// A finished campaign of robots over working days.
struct DaysData {
  std::filesystem::path directory;
  std::string text;  ///< of its campaign.yaml, as it was run
  twin::repeatability::Campaign campaign;
  twin::repeatability::Results results;
};

/// Reads the folder of `tribotwin lab`. Fails where the campaign is wrong, and where a test is missing or damaged, with
/// its file.
Result<DaysData> load_days(const std::filesystem::path& directory);

/// One self-contained page: verdict, changes, time constants, friction over the day, torques cold and hot, parameters
/// over the tests, base parameters. Fails where figures cannot be drawn at all (no gnuplot).
Result<Report> make_days_report(const DaysData& data, const ReportOptions& options);

}  // namespace tribotwin::render
