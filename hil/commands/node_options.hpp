#pragma once

#include <tribotwin/hil/commands/program.hpp>

namespace tribotwin::hil::program {

/// How the drives start, where that is not as they left the factory: of `drive`, and of the `replay` of such a session.
struct NodeOptions {
  bool unconfigured = false;

  void add_to(CLI::App& command);
  /// Of the drives in order. Throws InputError where the options do not fit them.
  std::vector<NodeSetup> setups(const twin::Scenario& robot, const RobotOptions& options) const;
};

}  // namespace tribotwin::hil::program
