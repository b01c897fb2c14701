#include <tribotwin/render/commands/page.hpp>
#include <tribotwin/render/report/sweep/sweep_report.hpp>

namespace tribotwin::render::program {
namespace {

int execute(const FolderOptions& a, const std::string& command_line) {
  const PageFile page(a, "campaign.yaml");
  const auto sweep = twin::or_wrong_input(twin::sweep::read_sweep(a.directory));
  return page.make(command_line, [&](const ReportOptions& options) { return make_sweep_report(sweep, options); });
}

}  // namespace

void add_sweep(CLI::App& app, Call& call) {
  auto a = std::make_shared<FolderOptions>();
  auto* command = app.add_subcommand("sweep",
                                     "Many runs of a scenario as a page: what matters most, distributions, response "
                                     "surfaces, bands, the worst runs");
  a->add_to(*command, "Folder of tribotwin sweep, finished or not");
  command->footer("Example:\n  tribotwin-report sweep runs/sweep -o sweep.html");
  command->callback([a, &call] { call.code = execute(*a, call.command_line); });
}

}  // namespace tribotwin::render::program
