#include <tribotwin/render/commands/page.hpp>
#include <tribotwin/render/report/diagnosis_report.hpp>

namespace tribotwin::render::program {
namespace {

struct Arguments : PageOptions {
  std::string healthy;
  std::vector<std::string> data;
  twin::diagnosis::ObservationOptions read;
  twin::TableArguments tables;
  DiagnosisOptions diagnosis;
};

int execute(const Arguments& a, const std::string& command_line) {
  auto read = a.read;
  read.table = twin::or_wrong_input(a.tables.options());
  read.table.joint = a.read.table.joint;
  const PageFile page(a, "diagnosis.html", inputs(a.data, a.healthy));
  const auto data = twin::or_wrong_input(load_diagnosis(a.healthy, {a.data.begin(), a.data.end()}, read, a.diagnosis));
  return page.make(command_line, [&](const ReportOptions& options) { return make_diagnosis_report(data, options); });
}

}  // namespace

void add_diagnosis(CLI::App& app, Call& call) {
  auto a = std::make_shared<Arguments>();
  auto* command = app.add_subcommand("diagnosis", "Verdicts on a joint as a page: distances, regions, causes, trend");
  command->add_option("HEALTHY", a->healthy, "healthy.yaml of tribotwin diagnose learn")->required();
  command->add_option("CURVES", a->data, "Friction curves, recordings or telemetry.h5, in the order of time")
      ->required();
  a->add_to(*command, "The page (default: diagnosis.html)");
  command->add_option("--false-alarm", a->diagnosis.check.false_alarm, "As of tribotwin diagnose check")
      ->check(CLI::Range(1e-9, 0.5))
      ->capture_default_str();
  command
      ->add_option("--tau-max", a->read.torque_max_nm,
                   "Largest manipulation torque [Nm], arm side, for curves in friction_norm alone")
      ->check(CLI::Range(1e-9, 1e9));
  command->add_option("--gear-ratio", a->read.gear_ratio, "Motor turns per joint turn, for recordings")
      ->check(CLI::Range(1e-6, 1e6));
  a->tables.add_to(*command);
  command->add_option("--joint", a->read.table.joint, "Joint of a table of several, such as a telemetry.h5");
  command->footer("Example:\n  tribotwin-report diagnosis healthy.yaml lab/br609/curves.csv -o diagnosis.html");
  command->callback([a, &call] { call.code = execute(*a, call.command_line); });
}

}  // namespace tribotwin::render::program
