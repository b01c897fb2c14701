#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/twin/simulation/twin.hpp>

/// Whether a run is what its scenario asked for: a table of checks, each with a threshold, its effect and a remedy.
namespace tribotwin::twin {

enum class Verdict {
  ok,
  note,      ///< beyond the threshold, but the run is as the scenario and its model ask
  expected,  ///< beyond the threshold, as the scenario's key `expects` says
  warning,   ///< the run is not what its scenario asked for
};
std::string_view name(Verdict verdict);

/// One result of a check, of a joint or, with an empty name, of the whole run.
struct Finding {
  std::string check, joint;
  double value = 0;
  std::string unit;
  double threshold = 0;  ///< a larger value is no longer ok
  Verdict verdict = Verdict::ok;
  std::string cause, effect, remedy;  ///< sentences without an end; empty where the value is ok
};

/// What the checks look at.
struct Examined {
  const Scenario& scenario;
  const Twin* twin = nullptr;  ///< none before the run
  double record_bytes = 0;     ///< predicted size of telemetry.h5; 0: nothing is written
};

struct HealthCheck {
  std::string_view name;       ///< in summary.json and in the scenario's key `expects`
  std::string_view measured;   ///< what, and its unit
  std::string_view threshold;  ///< and its reason
  std::string_view effect;
  Verdict verdict;  ///< beyond the threshold
  bool before_run;  ///< known from model and scenario
  /// Appends one finding per joint or for the run: joint, value, unit, threshold, cause and remedy.
  void (*examine)(const Examined& examined, std::vector<Finding>& findings);
};
std::span<const HealthCheck> health_checks();

/// The findings of all checks in the order of the table; without a twin, of those that are known before the run.
std::vector<Finding> examine(const Examined& examined);

/// A sentence per check that is not ok: `joint2: control saturated 93 % of the time (...): EFFECT; REMEDY`.
struct HealthLine {
  std::string check;
  Verdict verdict;
  std::string text;
};
/// Those of verdict `note` and `warning`, in the order of the findings.
std::vector<HealthLine> health_lines(std::span<const Finding> findings);
/// Whether no finding is a warning.
bool as_asked(std::span<const Finding> findings);

/// The table of checks as Markdown, for the README.
std::string health_markdown();

}  // namespace tribotwin::twin
