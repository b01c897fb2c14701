#pragma once

#include <string>
#include <vector>

#include <tribotwin/render/page/page.hpp>
#include <tribotwin/render/report/record/run_data.hpp>

/// The health check of a run, from its summary.json: of a run without one nothing is shown.
namespace tribotwin::render {

/// How many joints have drives with the parameters of a gear class, which are guesses.
std::size_t starting_points(const RunData& run);
/// What warned, one entry per check; of a run without a health check none.
struct Warning {
  std::string check, joint, remedy;
};
std::vector<Warning> warnings(const RunData& run);
/// "joint2, joint3": those that moved and left the range of their law; empty where none did.
std::string joints_outside_law(const RunData& run);
/// Whether its summary has checks; those of early versions have none.
bool has_checks(const RunData& run);
/// "The run is what its scenario asked for: none of 14 checks warns.", or how many do, or why nothing is known.
std::string as_asked_text(const RunData& run);
/// What the checks warn of and what follows, for the head of the page.
void add_warnings(pugi::xml_node to, const RunData& run);
/// What they note beside.
std::vector<std::string> health_notes(const RunData& run);
/// Every check with its worst joint.
void add_health_table(pugi::xml_node to, const RunData& run);
/// The warnings of the summary that are none of the health check.
std::vector<std::string> other_warnings(const RunData& run);

}  // namespace tribotwin::render
