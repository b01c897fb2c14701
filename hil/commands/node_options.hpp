#pragma once

#include <tribotwin/hil/commands/program.hpp>
#include <tribotwin/hil/session/session_file.hpp>

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
  /// The same with the content of the files. Throws InputError where one cannot be read.
  StartConditions conditions() const;
};

/// How the drives of a session started, from the session file of its log; none without one, or of an older version.
/// Throws InputError where that is damaged.
std::optional<StartConditions> recorded_conditions(const std::filesystem::path& log);
/// Throws InputError where options of a replay contradict what was recorded. A store that the session has changed
/// since is only noted.
void check_same(const StartConditions& given, const StartConditions& recorded, const std::filesystem::path& log);

enum class Use { live, replay };
/// Setups of the drives in order; a replay does not write the store. Throws InputError where the conditions do not fit
/// the drives.
std::vector<NodeSetup> node_setups(const twin::Scenario& robot, const RobotOptions& options,
                                   const StartConditions& conditions, Use use, const Wiring& wiring = {});

}  // namespace tribotwin::hil::program
