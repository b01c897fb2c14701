#include <fmt/format.h>

#include <tribotwin/hil/canopen/setup/store_file.hpp>
#include <tribotwin/hil/commands/node_options.hpp>

namespace tribotwin::hil::program {
namespace {

using twin::InputError;

/// What a drive stores goes into the file of all of them; a replay leaves the file alone.
ParameterKeeper::Keep keep_in(const std::shared_ptr<StoreFile>& store, std::uint32_t serial_number,
                              NodeOptions::Use use) {
  if (use == NodeOptions::Use::replay) return [](const KeptParameters&) { return true; };
  return [store, serial_number](const KeptParameters& parameters) {
    const auto kept = store->keep(serial_number, parameters);
    if (!kept) report_nonblocking(fmt::format("note: {}\n", kept.error().message));
    return kept.has_value();
  };
}

/// Throws InputError where the objects of the drive do not take the values of its setup.
void check(const DriveParameters& parameters, NodeSetup setup, const std::string& file) {
  const Node trial(
      parameters, [](const Frame&) { return Sent::done; }, std::move(setup));
  if (const auto& refused = trial.refused())
    throw InputError(fmt::format("{}:{}: drive {}: {}", file, refused->value.line, parameters.node, refused->text()));
}

}  // namespace

void NodeOptions::add_to(CLI::App& command) {
  command.add_flag("--unconfigured", unconfigured,
                   "The drives have no node numbers until a master gives them some (LSS)");
  command.add_option("--store", store, "File in which the drives keep what a master stores (1010h, LSS)");
}

std::vector<NamedFile> NodeOptions::files() const {
  if (store.empty()) return {};
  return {{"--store " + store, store}};
}

std::vector<NodeSetup> NodeOptions::setups(const twin::Scenario& robot, const RobotOptions& options, Use use) const {
  if (options.mirror() && (unconfigured || !store.empty()))
    throw InputError(
        fmt::format("{}: only drives of --profile cia402 have it", unconfigured ? "--unconfigured" : "--store"));
  std::vector<NodeSetup> setups(robot.model->drives().size(), {.unconfigured = unconfigured});
  if (store.empty()) return setups;
  const auto file = std::make_shared<StoreFile>(twin::or_wrong_input(StoreFile::read(store)));
  const auto parameters = drive_parameters(robot, options.first_node, options.cycle_us());
  for (std::size_t i = 0; i < setups.size(); ++i) {
    setups[i].kept = file->of(parameters[i].node);
    setups[i].keep = keep_in(file, parameters[i].node, use);
    check(parameters[i], setups[i], store);
  }
  return setups;
}

}  // namespace tribotwin::hil::program
