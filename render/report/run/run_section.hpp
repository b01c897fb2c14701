#pragma once

#include <functional>
#include <string>
#include <vector>

#include <tribotwin/render/page/illustrated.hpp>
#include <tribotwin/render/report/run/comparison.hpp>

namespace tribotwin::render {

/// How the page of a run begins, and that of several: with what differs most from the first.
Opening opening_of(const RunData& run, const ReportOptions& options);
Opening opening_of(const Runs& runs, const ReportOptions& options);

/// Adds all that a page says about one of its runs, and to `notes` what could not be shown. `progress` is of this run,
/// 0..1. Fails where figures cannot be drawn.
Result<void> add_run(IllustratedPage& page, const Runs& runs, std::size_t index, const std::string& command_line,
                     std::vector<std::string>& notes, const std::function<void(double)>& progress);

}  // namespace tribotwin::render
