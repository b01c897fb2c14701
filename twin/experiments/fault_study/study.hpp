#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/diagnosis/check.hpp>
#include <tribotwin/twin/experiments/friction/results.hpp>

/// Paper 2's whole experiment: the same campaign on several joints, a healthy state learned from some of its series,
/// verdicts on others. A campaign file with `joints` in place of `joint`, and `diagnosis`; the keys are documented in
/// twin/README.md.
namespace tribotwin::twin::study {

/// A series whose curves get a verdict, and what its author calls the joint's state: "cold".
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
/// Throws InputError.
Study load_study(const std::filesystem::path& file, const YAML::Node& campaign_tree);

/// Measures every joint in a folder of its own (results.hpp), then writes DIRECTORY/diagnosis.json: {JOINT:
/// {"observations":
/// [{"load_kg", "state", "region1": {"distance", "anomalous", ...}, "region2", ...}], "learned", ...}}. Fails where a
/// curve cannot be measured or judged. Counts of the summary are those of all joints.
Result<LabSummary> run_study(const Study& study, const LabOptions& options);

}  // namespace tribotwin::twin::study
