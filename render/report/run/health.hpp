#pragma once

#include <string>
#include <vector>

#include <tribotwin/render/page/page.hpp>
#include <tribotwin/render/report/run/run_data.hpp>

/// The health check of a run, from its summary.json: of a run without one nothing is shown.
namespace tribotwin::render {

/// How many joints have drives with the parameters of a gear class, which are guesses.
std::size_t starting_points(const RunData& run);
/// Whether the run is what its scenario asked for, and what the checks found, for the head of the page.
void add_verdict(pugi::xml_node to, const RunData& run);
/// Every check with its worst joint.
void add_health_table(pugi::xml_node to, const RunData& run);
/// The warnings of the summary that are none of the health check.
std::vector<std::string> other_warnings(const RunData& run);

}  // namespace tribotwin::render
