#pragma once

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/render/page/illustrated.hpp>
#include <tribotwin/twin/experiments/sweep/stored.hpp>

namespace tribotwin::render {

/// One self-contained page: a sentence with the first output and what moves it most, what matters most for each output,
/// distributions, outputs over the leading factors, bands, the worst runs with the commands that repeat them, failed
/// and warned runs. Fails where figures cannot be drawn at all (no gnuplot).
Result<Report> make_sweep_report(const twin::sweep::StoredSweep& sweep, const ReportOptions& options);

}  // namespace tribotwin::render
