#pragma once

#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/render/report/record/run_data.hpp>

/// What differs between runs: what was asked for, and what came of it. The first run is what others are compared with.
namespace tribotwin::render {

/// A key of the scenario, or of the record, with its value in each run; "–" where a run does not have it.
struct DifferingKey {
  std::string key;
  std::vector<std::string> values;
};
/// Keys whose values are not the same in all runs: "events[1].factors.Fc0".
std::vector<DifferingKey> differing_keys(std::span<const std::unique_ptr<RunData>> runs);

/// nullptr where the record has no such joint.
const JointHistory* history_of(const RunData& run, const std::string& joint);
/// Its mean friction power (JointHistory::friction_power_w) [W]; NaN without a joint.
double friction_power_w(const JointHistory* joint);

/// Friction of a joint in the first run and in another one, root mean square over the run.
struct FrictionChange {
  std::string joint;
  std::size_t run;  ///< the other one
  double first, other;
  std::string unit;
  double power_change_w;  ///< of the mean friction power (JointHistory::friction_power_w); NaN where a run has none
  double share() const { return other / first - 1; }
};
/// Of each joint that moved in both, run by run.
std::vector<FrictionChange> friction_changes(std::span<const std::unique_ptr<RunData>> runs);
/// Of those whose share is above resolved_share, or of all where none is, the one that changes friction power most: a
/// joint that hardly moves may have many times the friction and cost nothing. By friction where the power of any is not
/// known; nullptr where there is none.
const FrictionChange* largest(const std::vector<FrictionChange>& changes);
/// Of each joint but that of `most`, the change largest() prefers of those whose share is above `share`; in the same
/// order, the largest first.
std::vector<const FrictionChange*> others_beyond(double share, const std::vector<FrictionChange>& changes,
                                                 const FrictionChange& most);

/// Whether the power of all is known.
bool know_power(const std::vector<FrictionChange>& changes);

/// What the multi-rate simulation may leave of a difference; a difference within it is none. Measured against the full
/// run, root mean squares over 25 min: 2e-6 of the joint that works, 0.55 % of one that hardly moves, because its first
/// cycle, from rest, counts for those that are skipped after it.
constexpr double resolved_share = 1e-2;

/// "+47.1 Nm, +10.9 %", or "+47.1 ± 0.21 Nm, +10.9 %" where `scatter` (a standard deviation, in `unit`) is finite, 0
/// where it is below a millionth of the values; "none" where nothing changed by more. Without percent where a value is
/// negative, and of temperatures.
std::string change_text(double from, double to, const std::string& unit,
                        double scatter = std::numeric_limits<double>::quiet_NaN());

}  // namespace tribotwin::render
