#pragma once

#include <functional>
#include <string>
#include <vector>

#include <tribotwin/render/report/fit_data.hpp>
#include <tribotwin/render/report/illustrated.hpp>

namespace tribotwin::render {

struct FitReportOptions {
  std::vector<Format> figure_files;   ///< also every figure as a file of each of these formats
  std::string command;                ///< how this page was asked for; shown in it
  std::string version;                ///< of the program; shown in it
  std::function<void(double)> progress;
};

/// One self-contained page about an identified law: verdict, parameters, curves over points, residuals, correlation, origin.
/// Fails where figures cannot be drawn at all (no gnuplot).
tl::expected<Report, std::string> make_fit_report(const FitData& fit, const FitReportOptions& options);

}  // namespace tribotwin::render
