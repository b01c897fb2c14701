#pragma once

#include <cstddef>
#include <string>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/experiments/friction/campaign.hpp>
#include <tribotwin/twin/experiments/resumable_jobs.hpp>

namespace tribotwin::twin {

/// Of several MPI ranks rank 0 has all of it, the others `curves` and `present`.
struct LabSummary {
  std::size_t curves = 0, present = 0;  ///< all; those measured by an earlier run
  std::size_t levels = 0, outside = 0;  ///< rows of curves.csv; those outside the range of the law
  std::size_t saturated = 0;   ///< levels whose load and friction are beyond the torque limit of the robot's drive
  double torque_limit_nm = 0;  ///< of the drive with such levels, arm side
  double wall_s = 0;
};

/// Measures the curves that the campaign's folder lacks and writes curves.csv, in the order of the campaign. The folder
/// contains campaign.yaml (resolved) and every curve in curves/. Errors as in resumable_jobs.hpp.
Result<LabSummary> run_campaign(const Campaign& campaign, const LabOptions& options);

}  // namespace tribotwin::twin
