#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/render/report/illustrated.hpp>
#include <tribotwin/render/report/run_data.hpp>

namespace tribotwin::render {

struct ReportOptions {
  std::vector<Format> figure_files;     ///< also every figure as a file of each of these formats (poses are PNG always)
  std::string command;                  ///< how this report was asked for; shown in it
  std::function<void(double)> progress;
};

/// One self-contained page about one run, or about several with a comparison. Fails where figures cannot be drawn at all
/// (no gnuplot).
tl::expected<Report, std::string> make_report(std::span<const std::unique_ptr<RunData>> runs, const ReportOptions& options);

}  // namespace tribotwin::render
