#pragma once

#include <tribotwin/hil/commands/program.hpp>

namespace tribotwin::hil::program {

/// --can of a command that has one bus or two: BUS, or BUS=JOINT,... once per bus.
struct CanOptions {
  std::vector<std::string> given;

  /// `what`: BUS, in the help.
  CLI::Option* add_to(CLI::App& command, const std::string& what);
  /// BUS of each. Throws InputError for more than two, one without a name, and one that is given twice.
  std::vector<std::string> buses() const;
  /// The drives on each; empty where all are on one in their order. Throws InputError where the joints of the robot are
  /// not each on one bus.
  Wiring wiring(const twin::Scenario& robot) const;
};

/// That of a recorded session, by the file beside its log. Throws InputError where it is not of this robot.
Wiring wiring_of_log(const twin::Scenario& robot, const std::filesystem::path& log);

/// "nodes 1 to 3, on can0, nodes 1 to 3, on can1" for messages; `buses`: their names.
std::string nodes_on(const Wiring& wiring, std::size_t drives, int first_node, const std::vector<std::string>& buses);

}  // namespace tribotwin::hil::program
