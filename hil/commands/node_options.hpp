#pragma once

#include <tribotwin/hil/commands/program.hpp>

namespace tribotwin::hil::program {

/// How the drives start, where that is not as they left the factory: of `drive`, and of the `replay` of such a session.
struct NodeOptions {
  bool unconfigured = false;
  std::string store, eds;
  std::vector<std::string> dcfs;

  void add_to(CLI::App& command);
  /// What the drives may write, and what they read.
  std::vector<NamedFile> outputs() const;
  std::vector<NamedFile> inputs() const;
  enum class Use { live, replay };
  /// Of the drives in order; a replay does not write the store. Throws InputError where the options do not fit them.
  std::vector<NodeSetup> setups(const twin::Scenario& robot, const RobotOptions& options, Use use,
                                const Wiring& wiring = {}) const;
};

}  // namespace tribotwin::hil::program
