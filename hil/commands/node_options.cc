#include <algorithm>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/setup/eds_reader.hpp>
#include <tribotwin/hil/canopen/setup/store_file.hpp>
#include <tribotwin/hil/commands/node_options.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::hil::program {
namespace {

using twin::InputError;

/// What a drive stores goes into the file of all of them; a replay leaves the file alone.
ParameterKeeper::Keep keep_in(const std::shared_ptr<StoreFile>& store, std::uint32_t serial_number, Use use) {
  if (use == Use::replay) return [](const KeptParameters&) { return true; };
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
void configure(std::vector<NodeSetup>& setups, const std::vector<DriveParameters>& parameters, const StartFile& start) {
  const std::string file = start.name.string();
  const EdsFile dcf = twin::or_wrong_input(parse_eds(*start.content, file));
  if (!dcf.node_number)
    throw InputError(fmt::format("{}: does not say which drive it is for: NodeID=N in [DeviceComissioning]", file));
  const auto drive = std::ranges::find(parameters, *dcf.node_number, &DriveParameters::node);
  if (drive == parameters.end())
    throw InputError(fmt::format("{}: NodeID {}: the scenario has {}", file, *dcf.node_number,
                                 node_range(parameters.front().node, parameters.size())));
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

/// Gives the drives what they kept, and the file to keep more.
void keep(std::vector<NodeSetup>& setups, const std::vector<DriveParameters>& parameters, const StartFile& start,
          Use use) {
  const auto store = std::make_shared<StoreFile>(twin::or_wrong_input(StoreFile::parse(start.content, start.name)));
  for (std::size_t i = 0; i < setups.size(); ++i) {
    const DriveParameters& p = parameters[i];
    const std::uint32_t serial_number = p.serial_number ? p.serial_number : p.node;
    setups[i].kept = store->of(serial_number);
    setups[i].keep = keep_in(store, serial_number, use);
    check(p, setups[i], start.name.string());
  }
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

StartConditions NodeOptions::conditions() const {
  StartConditions conditions{.unconfigured = unconfigured};
  const auto add = [&](StartFile::Kind kind, const std::string& file, const char* what) {
    conditions.files.push_back({kind, file, twin::or_throw(twin::read_text(file, what))});
  };
  if (!eds.empty()) add(StartFile::Kind::eds, eds, "an EDS or DCF");
  for (const std::string& dcf : dcfs) add(StartFile::Kind::dcf, dcf, "an EDS or DCF");
  if (store.empty()) return conditions;
  if (std::error_code none; std::filesystem::exists(store, none))
    add(StartFile::Kind::store, store, "a store of drives");
  else
    conditions.files.push_back({StartFile::Kind::store, store, std::nullopt});
  return conditions;
}

std::optional<StartConditions> recorded_conditions(const std::filesystem::path& log) {
  const auto file = session_file_of(log);
  if (file.empty() || !std::filesystem::exists(file)) return std::nullopt;
  const SessionHead head = twin::or_wrong_input(SessionReader::open(file)).head();
  return head.complete ? std::optional(head.conditions) : std::nullopt;
}

void check_same(const StartConditions& given, const StartConditions& recorded, const std::filesystem::path& log) {
  const std::string session = session_file_of(log).string();
  if (given.unconfigured && !recorded.unconfigured)
    throw InputError(fmt::format("{}: was recorded without --unconfigured; leave it out", session));
  for (const StartFile& file : given.files) {
    const std::string option = fmt::format("--{} {}", word_of(file.kind), file.name.string());
    const auto alike = [&](const StartFile& r) { return r.kind == file.kind; };
    if (std::ranges::none_of(recorded.files, alike))
      throw InputError(fmt::format("{}: was recorded without --{}; leave it out", session, word_of(file.kind)));
    if (std::ranges::any_of(recorded.files, [&](const auto& r) { return alike(r) && r.content == file.content; }))
      continue;
    const std::string changed = fmt::format("{}: is not what the session began with", option);
    if (file.kind != StartFile::Kind::store)
      throw InputError(fmt::format("{}; leave the option out, {} holds the file as it was", changed, session));
    twin::note("{}; replayed with what {} holds", changed, session);
  }
}

std::vector<NodeSetup> node_setups(const twin::Scenario& robot, const RobotOptions& options,
                                   const StartConditions& conditions, Use use, const Wiring& wiring) {
  if (options.mirror() && conditions != StartConditions{})
    throw InputError("--unconfigured, --store, --eds, --dcf: only drives of --profile cia402 have them");
  const auto parameters = drive_parameters(robot, options.first_node, options.cycle_us(), wiring);
  std::vector<NodeSetup> setups(parameters.size(), {.unconfigured = conditions.unconfigured});
  for (const StartFile& file : conditions.files)
    if (file.kind == StartFile::Kind::eds) {
      const auto foreign = twin::or_wrong_input(twin::or_wrong_input(parse_eds(*file.content, file.name)).defaults());
      for (NodeSetup& setup : setups) setup.foreign = foreign;
    }
  for (const StartFile& file : conditions.files)
    if (file.kind == StartFile::Kind::dcf) configure(setups, parameters, file);
  for (const StartFile& file : conditions.files)
    if (file.kind == StartFile::Kind::store) keep(setups, parameters, file, use);
  return setups;
}

}  // namespace tribotwin::hil::program
