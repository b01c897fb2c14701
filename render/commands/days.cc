#include <tribotwin/render/commands/page.hpp>
#include <tribotwin/render/report/days_report.hpp>

namespace tribotwin::render::program {
namespace {

int execute(const FolderOptions& a, const std::string& command_line) {
  const PageFile page(a, "friction.csv");
  const auto data = twin::or_wrong_input(load_days(a.directory));
  return page.make(command_line, [&](const ReportOptions& options) { return make_days_report(data, options); });
}

}  // namespace

void add_days(CLI::App& app, Call& call) {
  auto a = std::make_shared<FolderOptions>();
  auto* command = app.add_subcommand("days",
                                     "Robots over working days as a page: time constants, friction over the day, "
                                     "torques cold and hot, parameters over tests, changes");
  a->add_to(*command, "Folder of tribotwin lab for a campaign of working days");
  command->footer("Example:\n  tribotwin-report days lab/days -o days.html");
  command->callback([a, &call] { call.code = execute(*a, call.command_line); });
}

}  // namespace tribotwin::render::program
