#pragma once

#include <deque>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <tribotwin/hil/canopen/budget.hpp>
#include <tribotwin/hil/commands/table.hpp>
#include <tribotwin/hil/session/bench.hpp>
#include <tribotwin/hil/session/files.hpp>
#include <tribotwin/twin/io/command_line/command_line.hpp>
#include <tribotwin/twin/io/destination.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/output.hpp>

/// What the commands of the program `tribotwin-hil` share. A command is one file and one row of table.hpp. It throws
/// errors (or_throw, InputError); parse.hpp of the program `tribotwin` maps them to exit codes.
namespace tribotwin::hil::program {

/// Declares a command: Arguments::add_to adds its options, `run` does the work and returns the exit code.
template <typename Arguments>
void declare(CLI::App& app, int& code, const char* name, const char* description, int (*run)(const Arguments&)) {
  const auto arguments = std::make_shared<Arguments>();
  auto* command = app.add_subcommand(name, description);
  arguments->add_to(*command);
  command->callback([arguments, run, &code] { code = run(*arguments); });
}

/// "tribotwin-hil: MESSAGE" on stderr; returns the exit code.
inline int report_error(twin::Exit code, const std::string& message) {
  return twin::report_error("tribotwin-hil", code, message);
}

/// Text to stderr during a session. It is dropped when the reader is not ready, because the bus must not wait for a
/// stopped terminal.
void report_nonblocking(const std::string& text);

/// Whether a signal has asked the command to end.
bool stop();

/// Options of all commands: the scenario and its drives on the bus.
struct RobotOptions {
  std::string scenario;
  std::vector<std::string> settings;
  int first_node = 1;
  double cycle_ms = 2;
  std::string profile = "cia402";
  const CLI::Option* cycle_option = nullptr;  ///< whether --cycle was given

  void add_to(CLI::App& command);
  void add_profile(CLI::App& command);

  /// Throws InputError where the scenario is wrong or does not fit on a bus.
  twin::Scenario load() const;
  bool mirror() const { return bench_profile() != Profile::cia402; }
  Profile bench_profile() const {
    return profile == "mirror" ? Profile::mirror : profile == "mirror-fd" ? Profile::mirror_fd : Profile::cia402;
  }
  /// The frames of the profile are FD frames.
  bool fd() const { return bench_profile() == Profile::mirror_fd; }
  std::uint32_t cycle_us() const;
  /// Of one of the buses.
  Budget budget(const twin::Scenario& robot, double bit_rate, const Wiring& wiring = {}, std::size_t bus = 0) const;
};

/// --force of the commands that write.
void add_force(CLI::App& command, bool& force);

/// "node 3", "nodes 1 to 6".
std::string node_range(int first, std::size_t count);

/// Before any work: throws InputError where a command may not write these files.
void check_outputs(const std::vector<NamedFile>& inputs, const std::vector<NamedFile>& outputs, bool force);

/// The drives of a scenario as the bus sees them before a master changes anything.
class Drives {
 public:
  Drives(const twin::Scenario& scenario, const RobotOptions& options, const Wiring& wiring = {});
  std::span<const DescribedDrive> all() const { return described_; }

 private:
  std::vector<DriveParameters> parameters_;
  std::deque<Dictionary> dictionaries_;
  std::vector<DescribedDrive> described_;
};

/// Writes a description of the drives to `destination`; returns the exit code.
int deliver(const twin::Scenario& scenario, const twin::Destination& destination, std::string_view text);

}  // namespace tribotwin::hil::program
