#include <CLI/CLI.hpp>

#include <tribotwin/render/commands/page.hpp>
#include <tribotwin/render/report/thermal/thermal_report.hpp>

namespace tribotwin::render::program {
namespace {

struct Arguments : PageOptions {
  std::string parameters;
  std::vector<std::string> data;
  std::vector<double> cycle_s;
  twin::TableArguments tables;
};

int execute(const Arguments& a, const std::string& command_line) {
  const auto tables = twin::or_wrong_input(a.tables.options());
  const auto data = twin::or_wrong_input(load_thermal(a.parameters, a.data, a.cycle_s, tables));
  const PageFile page(a, "thermal.html", inputs(data.recordings.files, a.parameters));
  return page.make(command_line, [&](const ReportOptions& options) { return make_thermal_report(data, options); });
}

}  // namespace

void add_thermal(CLI::App& app, Call& call) {
  auto a = std::make_shared<Arguments>();
  auto* command = app.add_subcommand(
      "thermal", "How joints warm up as a page: temperatures recorded and predicted, heat, parameters");
  command->add_option("PARAMS", a->parameters, "PARAMS.yaml of tribotwin thermal")->required();
  command->add_option("DATA", a->data,
                      "Recordings to compare with, as tribotwin thermal reads them (default: those that PARAMS.yaml "
                      "names)");
  a->add_to(*command, "The page (default: thermal.html)");
  command
      ->add_option("--work-cycle", a->cycle_s,
                   "Length of the working cycle [s], for heat from torque and motion: one, or one for each file as A,B")
      ->delimiter(',')
      ->check(CLI::Range(1e-3, 3600.0));
  a->tables.add_to(*command);
  a->tables.add_gear_ratio_to(*command);
  command->footer(
      "The data are yours, and so is what tribotwin thermal made of them, thermal.yaml say.\n"
      "Example:\n  tribotwin-report thermal thermal.yaml tuesday.csv -o thermal.html");
  command->callback([a, &call] { call.code = execute(*a, call.command_line); });
}

}  // namespace tribotwin::render::program
