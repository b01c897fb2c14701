#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include <tribotwin/plugins/drive/fault.hpp>
#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/diagnosis/check.hpp>
#include <tribotwin/twin/experiments/friction/campaign.hpp>
#include <tribotwin/twin/experiments/resumable_jobs.hpp>

/// The smallest fault that is detected, and whether it is named correctly: Monte Carlo over curves of the law with the
/// scatter of the campaign, thousands of times faster than the simulation of a test cycle.
namespace tribotwin::twin::study {

/// Levels of the campaign's healthy curves, from which curves are drawn.
struct LevelStatistics {
  std::vector<double> speed_rad_s, load_norm,
      stderr_nm;  ///< motor side; |load|; arm side, with level noise; means over curves
};

struct Power {
  const drive::FaultInfo* fault;
  double detection_limit = 0;           ///< severity at which 95 % of curves are anomalous
  std::map<std::string, double> named;  ///< at twice the limit: share of curves per verdict
  struct Point {
    double severity, false_alarm, detected;  ///< share of curves; severity 0: of healthy ones
  };
  std::vector<Point> roc;
};

/// Every fault, at temperatures drawn from the learned range, `draws` curves per severity. Collective; each fault in
/// a process of its own. ErrorKind::work where one failed: failures.csv in the folder of `options` lists those.
Result<std::vector<Power>> power_of(const Campaign& campaign, const LevelStatistics& levels,
                                    const diagnosis::HealthyState& healthy, std::size_t draws, double false_alarm,
                                    const LabOptions& options);

}  // namespace tribotwin::twin::study
