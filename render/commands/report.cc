#include <algorithm>
#include <iterator>

#include <fmt/format.h>

#include <tribotwin/render/commands/page.hpp>
#include <tribotwin/render/report/run/run_report.hpp>

namespace tribotwin::render::program {
namespace {

struct Arguments : PageOptions {
  std::vector<std::string> runs;
};

int execute(const Arguments& a, const std::string& command_line) {
  if (a.runs.empty()) throw twin::InputError("the folder of a run is missing; see 'tribotwin-report --help'");
  std::vector<std::unique_ptr<RunData>> runs;
  std::vector<std::filesystem::path> read;
  for (const auto& directory : a.runs) {
    std::ranges::move(twin::or_wrong_input(load_runs(directory)), std::back_inserter(runs));
    std::ranges::move(run_files(directory), std::back_inserter(read));
  }
  const std::filesystem::path folder = a.runs.size() == 1 ? a.runs[0] : "";
  const PageFile page(a, folder / "report.html", read);
  int code = page.make(command_line, [&](const ReportOptions& options) { return make_run_report(runs, options); });
  for (const auto& run : runs)
    if (!run->damage.empty())
      code = twin::report_error("tribotwin-report", twin::failed,
                                fmt::format("{}: the record is damaged, and the page shows what is left of it",
                                            (run->directory / "telemetry.h5").string()));
  return code;
}

}  // namespace

void add_report(CLI::App& app, Call& call) {
  auto a = std::make_shared<Arguments>();
  app.add_option("RUNDIR", a->runs, "Folders of runs, or of a scenario that varies; several runs are compared");
  a->add_to(app, "The page (default: RUNDIR/report.html; report.html for several)");
  app.footer(
      "Exit code 1 where a record is damaged; the page is written from what is left of it.\nExample:\n  "
      "tribotwin-report runs/irb6620_warmup -o report.html\n\nThe run is that of tribotwin run "
      "irb6620_warmup.");
  app.callback([a, &app, &call] {
    if (app.get_subcommands().empty()) call.code = execute(*a, call.command_line);
  });
}

}  // namespace tribotwin::render::program
