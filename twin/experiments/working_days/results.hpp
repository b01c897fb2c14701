#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/experiments/resumable_jobs.hpp>
#include <tribotwin/twin/experiments/working_days/findings.hpp>

namespace tribotwin::twin::repeatability {

/// A finished campaign.
struct Results {
  std::vector<WorkingDay> days;  ///< in the order of the tests
  Findings findings;
  std::size_t present = 0;                   ///< tests made by an earlier run
  std::vector<std::filesystem::path> files;  ///< written by this run, beside the tests
};

/// Makes the tests that the campaign's folder lacks, each a file in tests/, and writes its tables and motion.csv.
/// Errors as in experiments/resumable_jobs.hpp; ErrorKind::input also where a day is shorter than a cycle of the
/// motion.
Result<Results> run_campaign(const Campaign& campaign, const LabOptions& options);

/// Results of a finished campaign's folder. ErrorKind::input with the file where a test is missing or damaged.
Result<Results> read_results(const Campaign& campaign, const std::filesystem::path& directory);

}  // namespace tribotwin::twin::repeatability
