#pragma once

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/render/page/illustrated.hpp>
#include <tribotwin/render/report/fit_data.hpp>

namespace tribotwin::render {

/// One self-contained page about an identified law: verdict, parameters, curves over points, residuals, correlation,
/// origin. Fails where figures cannot be drawn at all (no gnuplot).
Result<Report> make_fit_report(const FitData& fit, const ReportOptions& options);

}  // namespace tribotwin::render
