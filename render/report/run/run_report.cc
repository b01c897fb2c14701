#include <tribotwin/render/report/run/comparison.hpp>
#include <tribotwin/render/report/run/run_report.hpp>
#include <tribotwin/render/report/run/run_section.hpp>

namespace tribotwin::render {

Result<Report> make_run_report(std::span<const std::unique_ptr<RunData>> all, const ReportOptions& options) {
  const Runs runs{all};
  IllustratedPage page(runs.title(), options.figure_files);
  page.add(page.body(), "h1", runs.title());
  if (all.size() > 1) {
    page.open(opening_of(runs, options));
    if (auto ok = add_comparison(page, runs); !ok) return tl::unexpected(ok.error());
  }
  if (all.size() == 1) page.open(opening_of(*all[0], options));
  std::vector<std::string> notes;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto progress = [&](double share_of_run) {
      if (options.progress) options.progress((static_cast<double>(i) + share_of_run) / static_cast<double>(all.size()));
    };
    if (auto ok = add_run(page, runs, i, options.command, notes, progress); !ok) return tl::unexpected(ok.error());
  }
  return page.report(std::move(notes));
}

}  // namespace tribotwin::render
