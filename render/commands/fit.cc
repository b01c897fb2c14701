#include <tribotwin/render/commands/page.hpp>
#include <tribotwin/render/report/fit_report.hpp>

namespace tribotwin::render::program {
namespace {

struct Arguments : PageOptions {
  std::string parameters;
  std::vector<std::string> data;
  twin::identification::ReadOptions read;
  twin::TableArguments tables;
};

int execute(const Arguments& a, const std::string& command_line) {
  auto read = a.read;
  read.table = twin::or_wrong_input(a.tables.options());
  read.table.joint = a.read.table.joint;
  const PageFile page(a, "fit.html", inputs(a.data, a.parameters));
  const auto data = twin::or_wrong_input(load_fit(a.parameters, {a.data.begin(), a.data.end()}, read));
  return page.make(command_line, [&](const ReportOptions& options) { return make_fit_report(data, options); });
}

}  // namespace

void add_fit(CLI::App& app, Call& call) {
  auto a = std::make_shared<Arguments>();
  auto* command =
      app.add_subcommand("fit", "An identified law as a page: parameters, curves over points, residuals, correlation");
  command->add_option("PARAMS", a->parameters, "PARAMS.yaml of tribotwin identify or calibrate")->required();
  command->add_option(
      "DATA", a->data,
      "Friction curves, recordings or telemetry.h5 to show the law with (default: those that PARAMS.yaml names)");
  a->add_to(*command, "The page (default: fit.html)");
  add_units(*command, a->read);
  a->tables.add_to(*command);
  command->add_option("--joint", a->read.table.joint, "Joint of a table of several, such as a telemetry.h5");
  command->footer(
      "The data are yours, and so is what tribotwin identify made of them, params.yaml say. DATA have the columns that "
      "it "
      "reads: friction curves speed_rad_s (motor side) and friction_nm or friction_norm, optionally load_norm, "
      "temperature_degC, stderr_nm or stderr_norm, curve; recordings time_s, position_rad, torque_nm, optionally "
      "velocity_rad_s, temperature_degC, load_nm. Other names: --columns.\n"
      "Example:\n  tribotwin-report fit params.yaml -o fit.html");
  command->callback([a, &call] { call.code = execute(*a, call.command_line); });
}

}  // namespace tribotwin::render::program
