#include <tribotwin/hil/commands/node_options.hpp>

namespace tribotwin::hil::program {

using twin::InputError;

void NodeOptions::add_to(CLI::App& command) {
  command.add_flag("--unconfigured", unconfigured,
                   "The drives have no node numbers until a master gives them some (LSS)");
}

std::vector<NodeSetup> NodeOptions::setups(const twin::Scenario& robot, const RobotOptions& options) const {
  if (options.mirror() && unconfigured) throw InputError("--unconfigured: only drives of --profile cia402 have LSS");
  return std::vector<NodeSetup>(robot.model->drives().size(), {.unconfigured = unconfigured});
}

}  // namespace tribotwin::hil::program
