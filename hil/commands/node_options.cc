#include <algorithm>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/setup/eds_reader.hpp>
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
void check(const DriveParameters& parameters, const NodeSetup& setup, const std::string& file) {
  const Node trial(
      parameters, [](const Frame&) { return Sent::done; }, setup);
  if (const auto& refused = trial.refused())
    throw InputError(fmt::format("{}:{}: drive {}: {}", file, refused->value.line, parameters.node, refused->text()));
}

/// Gives the drive that a DCF names its values.
void configure(std::vector<NodeSetup>& setups, const std::vector<DriveParameters>& parameters,
               const std::string& file) {
  const EdsFile dcf = twin::or_wrong_input(read_eds_file(file));
  if (!dcf.node_number)
    throw InputError(fmt::format("{}: does not say which drive it is for: NodeID=N in [DeviceComissioning]", file));
  const auto drive = std::ranges::find(parameters, *dcf.node_number, &DriveParameters::node);
  if (drive == parameters.end())
    throw InputError(fmt::format("{}: NodeID {}: the drives are nodes {} to {}", file, *dcf.node_number,
                                 parameters.front().node, parameters.back().node));
  if (std::ranges::count(parameters, *dcf.node_number, &DriveParameters::node) > 1)
    throw InputError(
        fmt::format("{}: NodeID {} is a drive on each bus; --dcf is for robots on one bus", file, *dcf.node_number));
  NodeSetup& setup = setups[static_cast<std::size_t>(drive - parameters.begin())];
  if (!setup.values.empty()) throw InputError(fmt::format("{}: node {} has a DCF already", file, *dcf.node_number));
  setup.values = twin::or_wrong_input(dcf.values(*dcf.node_number));
  if (setup.values.empty())
    throw InputError(fmt::format("{}: has no ParameterValue of an object that can be written", file));
  check(*drive, setup, file);
}

}  // namespace

void NodeOptions::add_to(CLI::App& command) {
  command.add_flag("--unconfigured", unconfigured,
                   "The drives have no node numbers until a master gives them some (LSS)");
  command.add_option("--store", store, "File in which the drives keep what a master stores (1010h, LSS)");
  command.add_option("--eds", eds, "EDS of another maker's drive: the drives have its objects beside their own");
  command
      .add_option("--dcf", dcfs, "DCF with values of the objects of the drive that its NodeID names; repeat for more")
      ->allow_extra_args(false);
}

std::vector<NamedFile> NodeOptions::outputs() const {
  if (store.empty()) return {};
  return {{"--store " + store, store}};
}

std::vector<NamedFile> NodeOptions::inputs() const {
  std::vector<NamedFile> files;
  if (!eds.empty()) files.push_back({"--eds " + eds, eds});
  for (const std::string& dcf : dcfs) files.push_back({"--dcf " + dcf, dcf});
  return files;
}

std::vector<NodeSetup> NodeOptions::setups(const twin::Scenario& robot, const RobotOptions& options, Use use,
                                           const Wiring& wiring) const {
  if (options.mirror() && (unconfigured || !store.empty() || !eds.empty() || !dcfs.empty()))
    throw InputError("--unconfigured, --store, --eds, --dcf: only drives of --profile cia402 have them");
  const auto parameters = drive_parameters(robot, options.first_node, options.cycle_us(), wiring);
  std::vector<NodeSetup> setups(parameters.size(), {.unconfigured = unconfigured});
  if (!eds.empty()) {
    const auto foreign = twin::or_wrong_input(twin::or_wrong_input(read_eds_file(eds)).defaults());
    for (NodeSetup& setup : setups) setup.foreign = foreign;
  }
  for (const std::string& dcf : dcfs) configure(setups, parameters, dcf);
  if (store.empty()) return setups;
  const auto file = std::make_shared<StoreFile>(twin::or_wrong_input(StoreFile::read(store)));
  for (std::size_t i = 0; i < setups.size(); ++i) {
    const DriveParameters& p = parameters[i];
    const std::uint32_t serial_number = p.serial_number ? p.serial_number : p.node;
    setups[i].kept = file->of(serial_number);
    setups[i].keep = keep_in(file, serial_number, use);
    check(parameters[i], setups[i], store);
  }
  return setups;
}

}  // namespace tribotwin::hil::program
