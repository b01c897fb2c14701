#pragma once

#include <cstddef>
#include <string>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/experiments/friction/campaign.hpp>
#include <tribotwin/twin/experiments/resumable_jobs.hpp>

namespace tribotwin::twin {

struct LabSummary {
  std::size_t curves = 0, present = 0;  ///< in all; measured by an earlier run
  std::size_t levels = 0, outside = 0;  ///< rows of curves.csv; those outside the range of the law
  double wall_s = 0;
};

/// Measures what a campaign's folder lacks and writes curves.csv, rows in the order of the campaign. The folder holds
/// campaign.yaml (resolved) and every curve in curves/ (resumable_jobs.hpp, also for what it throws and how it fails).
Result<LabSummary> run_campaign(const Campaign& campaign, const LabOptions& options);

}  // namespace tribotwin::twin
