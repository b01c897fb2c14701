#pragma once

#include <memory>
#include <span>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/render/page/illustrated.hpp>
#include <tribotwin/render/report/record/run_data.hpp>

namespace tribotwin::render {

/// One self-contained page about at least one run, with a comparison of several. Fails where figures cannot be drawn at
/// all (no gnuplot).
Result<Report> make_run_report(std::span<const std::unique_ptr<RunData>> runs, const ReportOptions& options);

}  // namespace tribotwin::render
