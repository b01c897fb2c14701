#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include <tribotwin/render/figure/figures.hpp>
#include <tribotwin/render/page/figure_table.hpp>
#include <tribotwin/render/report/record/run_data.hpp>

/// Drives behind a transmission: torque over torsion, and how the arm follows its set point.
namespace tribotwin::render {

bool has_transmission(const JointHistory& joint);

/// Torque over torsion in the load's last period, that of the summary's `loops`; over all samples without one.
Loop last_loop(std::string label, const RunData& run, const JointHistory& joint);
Figure loop_figure(std::span<const Loop> loops);

/// Set point minus position of the arm [rad]; nothing where the set point rests or either is unknown.
std::optional<Trace> arm_error(std::string label, const RunData& run, const JointHistory& joint);

/// Of a joint that has a transmission.
std::span<const FigureRow<RunData, JointHistory>> transmission_figures();

/// Adds the results of the runs' transmissions from their summaries; `label` names a run.
void add_transmission_tables(IllustratedPage& page, pugi::xml_node to, std::span<const std::unique_ptr<RunData>> runs,
                             const std::function<std::string(const RunData&)>& label);

}  // namespace tribotwin::render
