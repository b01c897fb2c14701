#pragma once

#include <string>
#include <vector>

#include <tribotwin/twin/experiments/working_days/findings.hpp>

/// The results of a campaign as files and text.
namespace tribotwin::twin::repeatability {

struct TableFile {
  std::string name, text;
};
/// time_constants.csv, inertial.csv, friction.csv, changes.csv. `days` in the order of the tests.
std::vector<TableFile> tables(const Campaign& campaign, const std::vector<WorkingDay>& days, const Findings& findings);

/// For people: time constants, scatter of inertial parameters, changes.
std::string summary(const Campaign& campaign, const std::vector<WorkingDay>& days, const Findings& findings);

}  // namespace tribotwin::twin::repeatability
