#include <fmt/format.h>

#include <tribotwin/hil/canopen/eds.hpp>
#include <tribotwin/hil/commands/program.hpp>

namespace tribotwin::hil::program {
namespace {

struct Arguments : RobotOptions {
  twin::Destination destination;
  int node = 0;

  void add_to(CLI::App& command) {
    RobotOptions::add_to(command);
    command.add_option("--node", node, "Of this node (default: the first)");
    destination.add_to(command, "File to write (default: stdout)");
    command.footer("Example:\n  tribotwin-hil eds twin/scenarios/irb6620_hold.yaml -o drive.eds");
  }
};

int run(const Arguments& a) {
  const twin::Scenario scenario = a.load();
  const Drives drives(scenario, a);
  for (const auto& described : drives.all())
    if (a.node == 0 || described.parameters->node == a.node)
      return deliver(scenario, a.destination, hil::eds(*described.dictionary, *described.parameters));
  const auto count = drives.all().size();
  throw twin::InputError(fmt::format("--node {}: the scenario has {}; --first-node numbers them anew", a.node,
                                     node_range(a.first_node, count)));
}

}  // namespace

void add_eds(CLI::App& app, int& code) { declare(app, code, "eds", "The electronic data sheet of a drive", run); }

}  // namespace tribotwin::hil::program
