#pragma once

#include <tribotwin/render/page/illustrated.hpp>
#include <tribotwin/render/report/record/run_data.hpp>

namespace tribotwin::render {

/// Adds to the figures of `grid` the temperatures of a run that repeats its work cycle, predicted from its record:
/// sliders move them to another ambient temperature, and to more standing still. Where joints warmed but cannot be
/// predicted it says why, below; where none warmed, where cycles are not recorded or where there is no kernel it shows
/// nothing.
///
/// A joint's friction power is a function of its temperature alone, because its motion repeats: that of the law over
/// the speeds and loads of the last complete cycle, times the ratio of the recorded power to it. Its heat is stepped by
/// thermal::step. A joint whose record this does not follow is left out.
Result<void> show_warm_up(IllustratedPage& page, pugi::xml_node grid, const RunData& run);

}  // namespace tribotwin::render
