#include <tribotwin/render/commands/page.hpp>
#include <tribotwin/render/report/dynamics/dynamics_report.hpp>

namespace tribotwin::render::program {
namespace {

struct Arguments : PageOptions {
  std::string predicted;
};

int execute(const Arguments& a, const std::string& command_line) {
  const auto data = twin::or_wrong_input(load_dynamics(a.predicted));
  const PageFile page(a, "dynamics.html", data.files);
  return page.make(command_line, [&](const ReportOptions& options) { return make_dynamics_report(data, options); });
}

}  // namespace

void add_dynamics(CLI::App& app, Call& call) {
  auto a = std::make_shared<Arguments>();
  auto* command = app.add_subcommand(
      "dynamics", "Predicted torques of a robot as a page: errors, what they depend on, friction parameters");
  command->add_option("PREDICTED", a->predicted, "JSON of tribotwin predict, with its table beside it")->required();
  a->add_to(*command, "The page (default: dynamics.html)");
  command->footer(
      "The data are yours: tribotwin dynamics made robot.yaml of recordings of a robot, and tribotwin predict "
      "robot.xml robot.yaml tuesday.csv -o predicted.csv --json > predicted.json compared with another.\n"
      "Example:\n  tribotwin-report dynamics predicted.json -o dynamics.html");
  command->callback([a, &call] { call.code = execute(*a, call.command_line); });
}

}  // namespace tribotwin::render::program
