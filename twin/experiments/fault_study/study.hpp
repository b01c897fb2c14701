#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/diagnosis/check.hpp>
#include <tribotwin/twin/experiments/friction/results.hpp>

/// Zhou 2024's experiment: the same campaign on several joints, a healthy state learned from some of its series,
/// verdicts on others. A campaign file with `joints` in place of `joint`, and `diagnosis`.
namespace tribotwin::twin::study {

/// A series whose curves get a verdict, and the author's name of the joint's state: "cold".
struct Checked {
  std::string series, state;
};

struct Joint {
  std::string name;
  Campaign campaign;
};

struct Study {
  std::vector<Joint> joints;
  std::vector<std::string> learn;  ///< series
  std::vector<Checked> check;
  double false_alarm = diagnosis::two_sigma_false_alarm;  ///< of each verdict, per region and indicator
  std::size_t draws = 0;  ///< curves per severity of the Monte Carlo (power.hpp); 0: none
};

bool is_study(const YAML::Node& campaign_tree);
/// ErrorKind::input with file, key and what would be right.
Result<Study> load_study(const std::filesystem::path& file, const YAML::Node& campaign_tree);

/// Measures every joint in a folder of its own (results.hpp), then writes DIRECTORY/diagnosis.json: {JOINT:
/// {"observations": [{"load_kg", "state", "region1": {"distance", "anomalous", ...}, "region2", ...}], "learned",
/// ...}}. ErrorKind::input where a joint has too few curves to learn from, otherwise as in results.hpp; ErrorKind::work
/// where a curve cannot be judged. Counts of the summary are sums over the joints.
Result<LabSummary> run_study(const Study& study, const LabOptions& options);

}  // namespace tribotwin::twin::study
