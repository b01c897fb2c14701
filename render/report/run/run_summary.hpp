#pragma once

#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

#include <tribotwin/render/report/record/run_data.hpp>

/// The values of a run's summary.json, which may be damaged: NaN, empty text or an empty list where a value is missing.
namespace tribotwin::render {

double number(const nlohmann::json& json, std::initializer_list<const char*> path);
std::string text(const nlohmann::json& json, const char* key);
/// The list of this name.
const nlohmann::json& entries(const RunData& run, const char* key);

/// "–" for NaN.
std::string shown(double value, const char* format);
/// With so many digits (theme.hpp), so that large values have no power of ten.
std::string shown(double value, int digits);

/// Of a joint's maximum torque: "0.763", "27761" of an overloaded one.
std::string load_text(double share);

/// "kJ" and how many J it is: the unit in which so much work has 1 to 4 digits.
std::pair<const char*, double> energy_unit(double joule);

/// A joint over a run; NaN where it is not known. Friction is the magnitude, arm side.
struct JointSummary {
  std::string name;
  double start_degC, end_degC, max_degC, friction_rms_nm, friction_max_nm, load_max;
  double outside_share, stuck_share;  ///< of time: outside the range of the law, held by friction
};

/// From the summary or, where it has none, from the samples.
std::vector<JointSummary> joint_summaries(const RunData& run);
/// nullptr where no temperature is known.
const JointSummary* warmest(const std::vector<JointSummary>& joints);
/// The joint that warmed most, by more than 1 K, of those that moved; nullptr where none did.
const JointSummary* most_warmed(const RunData& run, const std::vector<JointSummary>& joints);
/// NaN where neither the summary nor the samples say so.
double simulated_s(const RunData& run);

}  // namespace tribotwin::render
