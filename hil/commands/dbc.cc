#include <tribotwin/hil/canopen/dbc.hpp>
#include <tribotwin/hil/commands/program.hpp>
#include <tribotwin/hil/mirror/mirror.hpp>

namespace tribotwin::hil::program {
namespace {

struct Arguments : RobotOptions {
  twin::Destination destination;

  void add_to(CLI::App& command) {
    RobotOptions::add_to(command);
    add_profile(command);
    destination.add_to(command, "File to write (default: stdout)");
    destination.add_json_to(command);
    command.footer("Example:\n  tribotwin-hil dbc twin/scenarios/irb6620_hold.yaml -o drives.dbc");
  }
};

int run(const Arguments& a) {
  const twin::Scenario scenario = a.load();
  const Drives drives(scenario, a);
  if (!a.mirror()) return deliver(scenario, a.destination, hil::dbc(drives.all()));
  std::vector<DescribedMirror> all;
  for (const auto& d : drives.all())
    all.push_back({d.parameters->node, d.parameters->name, d.parameters->rated_torque_nm * d.parameters->gear_ratio});
  return deliver(scenario, a.destination, mirror_dbc(all, mirror_format(a.bench_profile())));
}

}  // namespace

void add_dbc(CLI::App& app, int& code) { declare(app, code, "dbc", "All cyclic frames of all drives as a DBC", run); }

}  // namespace tribotwin::hil::program
