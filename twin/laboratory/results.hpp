#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <string>

#include <tl/expected.hpp>

#include <tribotwin/twin/laboratory/campaign.hpp>

namespace tribotwin::twin {

struct LabOptions {
  std::filesystem::path directory;
  unsigned threads = 0;                                            ///< 0: all cores
  std::function<void(double share, double seconds_left)> progress; ///< from one thread at a time
};

struct LabSummary {
  std::size_t curves = 0, present = 0;   ///< in all; measured by an earlier run
  std::size_t levels = 0, outside = 0;   ///< rows of curves.csv; those outside the range of the law
  double wall_s = 0;
};

/// Measures what a campaign's folder lacks and writes curves.csv, rows in the order of the campaign. The folder holds
/// campaign.yaml (resolved) and, from the moment it is measured, every curve in curves/: however a run ends, the next one of
/// the same campaign goes on, and curves.csv comes out the same byte by byte, whatever the number of threads.
/// Throws InputError where the folder holds another campaign or something else. Fails when a curve cannot be measured, another
/// process works in the folder, or a file cannot be written.
tl::expected<LabSummary, std::string> run_campaign(const Campaign& campaign, const LabOptions& options);

}  // namespace tribotwin::twin
