#pragma once

#include <span>

#include <tribotwin/render/page/figure_table.hpp>
#include <tribotwin/render/report/record/run_data.hpp>

namespace tribotwin::render {

Axis lubricant_temperature();

/// A run over time: temperatures, friction, its first and last work cycle, its error against a recording.
std::span<const FigureRow<RunData>> history_figures();

}  // namespace tribotwin::render
