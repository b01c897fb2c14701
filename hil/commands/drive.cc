#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <tribotwin/hil/commands/can_options.hpp>
#include <tribotwin/hil/commands/node_options.hpp>
#include <tribotwin/hil/commands/status_line.hpp>
#include <tribotwin/hil/live/bench_feed.hpp>
#include <tribotwin/hil/session/drive.hpp>
#include <tribotwin/hil/session/session_file.hpp>
#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/live/web_options.hpp>

namespace tribotwin::hil::program {
namespace {

using twin::InputError;

/// Before any work, so that a session does not end in vain.
void check_statistics(const std::string& file, bool force) {
  if (file.empty()) return;
  twin::or_wrong_input(twin::check_output(file, twin::Existing::replace));
  twin::or_wrong_input(twin::check_output(file, twin::replace_if(force)));
  if (std::filesystem::exists(file) && !std::filesystem::is_regular_file(file)) return;
  twin::or_throw(twin::NewFile::create(file, twin::Existing::replace));  // writes nothing and leaves nothing
}

/// A store is read, and replaced as a whole.
void check_store(const std::filesystem::path& file) {
  std::error_code none;
  if (std::filesystem::exists(file, none) && !std::filesystem::is_directory(file, none) &&
      !std::filesystem::is_regular_file(file, none))
    throw InputError(fmt::format("--store {}: must be a regular file, not a pipe or a device", file.string()));
  twin::or_wrong_input(twin::check_output(file, twin::Existing::replace));
}

void note_missing_brakes(const twin::Scenario& scenario) {
  std::vector<std::string> joints;
  for (const auto& binding : scenario.model->drives())
    if (binding.drive.brake_torque_nm == 0) joints.push_back(twin::joint_name(scenario.model->get(), binding));
  if (!joints.empty())
    report_nonblocking(fmt::format("note: no brake holds {} (brake_torque_nm is 0): without power gravity moves it\n",
                                   fmt::join(joints, ", ")));
}

struct Arguments : RobotOptions {
  NodeOptions start;
  CanOptions can;
  std::string record, stats, output, faults;
  std::optional<double> duration, bit_rate;
  bool realtime = false, lockstep = false, json = false, quiet = false, force = false;
  twin::live::WebOptions web;

  void add_to(CLI::App& command) {
    RobotOptions::add_to(command);
    add_profile(command);
    start.add_to(command);
    can.add_to(command, "BUS: vcan0, can0, socketcand://127.0.0.1:29536/NAME, gateway://HOST:29536/NAME")->required();
    command
        .add_option("--bitrate,--bit-rate", bit_rate,
                    "Of the bus [bit/s]; without it that of the device, and no limit on vcan and TCP, which have none")
        ->check(CLI::Range(1e4, 1e6));
    auto* clock = command.add_flag("--realtime", realtime, "The robot moves with the clock");
    command.add_flag("--sync-lockstep", lockstep, "Every SYNC advances the robot by one cycle (default)")
        ->excludes(clock);
    command.add_option("--duration", duration, "Simulated time after which the session ends [s]")
        ->check(CLI::PositiveNumber);
    command.add_option("--record", record, "Everything on the bus as a candump log, and LOG.session for replay");
    command.add_option("--stats", stats, "Counters of the session as JSON");
    command.add_option("--faults", faults, "Injected faults: a YAML list (hil/faults/README.md)");
    command.add_option("-o,--output", output, "Folder for telemetry.h5, scenario.yaml, summary.json");
    add_force(command, force);
    web.add_to(command);
    command.add_flag("--json", json, "Print the counters of --stats at the end");
    command.add_flag("--quiet", quiet, "No status line");
    command.footer(
        "Example:\n  tribotwin-hil drive irb6620_hold --can socketcand://127.0.0.1:29536/can0 --realtime --duration 10 "
        "--record session.log");
  }

  /// The folder of what is written.
  std::filesystem::path results() const {
    return output.empty() ? std::filesystem::path(record).parent_path() : std::filesystem::path(output);
  }

  void check_files(const twin::Scenario& robot) const {
    auto inputs = files_of(robot);
    inputs.push_back({"--faults " + faults, faults});
    auto outputs = files_in(output);
    outputs.push_back({"--record " + record, record});
    if (const auto beside = session_file_of(record); !beside.empty())
      outputs.push_back({"the file beside --record " + record, beside});
    outputs.push_back({"--stats " + stats, stats});
    const auto kept = start.outputs(), read = start.inputs();
    inputs.insert(inputs.end(), read.begin(), read.end());
    check_outputs(inputs, outputs, force);
    outputs.insert(outputs.end(), kept.begin(), kept.end());
    twin::or_wrong_input(refuse_shared(inputs, outputs));  // a store may exist
    for (const auto& file : kept) check_store(file.path);
    if (!record.empty()) twin::or_wrong_input(twin::check_output(record, twin::Existing::replace));
    check_statistics(stats, force);
  }

  /// Throws InputError where a bus of this bit rate cannot carry the drives.
  void check_bus_load(const twin::Scenario& robot, double rate, const Wiring& wiring, std::size_t bus) const {
    const Budget load = budget(robot, rate, wiring, bus);
    const std::string where = wiring.size() > 1 ? can.buses()[bus] + ": " : "";
    if (load.max > 1)
      throw InputError(fmt::format("{}--cycle {} at {:g} kbit/s: {}; choose a longer cycle or fewer drives on one bus",
                                   where, cycle_ms, 1e-3 * rate, load.line()));
    if (load.max > 0.8) twin::note("{}{}", where, load.line());
  }
};

void show(const SessionStatus& s) { report_nonblocking("\r\033[K" + status_line(s, terminal_columns())); }

/// Opens the buses and checks their load: all, or none is left open.
std::vector<std::unique_ptr<Transport>> open_buses(const Arguments& a, const twin::Scenario& scenario,
                                                   const Wiring& wiring) {
  std::vector<std::unique_ptr<Transport>> buses;
  for (const std::string& address : a.can.buses()) {
    buses.push_back(twin::or_wrong_input(open_bus(address, {.fd = a.fd()})));
    if (const auto rate = buses.back()->bit_rate(); rate && !a.bit_rate)
      a.check_bus_load(scenario, *rate, wiring, buses.size() - 1);
  }
  return buses;
}

void announce(const Arguments& a, const twin::Scenario& scenario, const Wiring& wiring) {
  const std::size_t drives = scenario.model->drives().size();
  report_nonblocking(fmt::format("{} drive{}, {}; {}\n", drives, drives == 1 ? "" : "s",
                                 nodes_on(wiring, drives, a.first_node, a.can.buses()),
                                 a.realtime          ? "the robot moves with the clock"
                                 : wiring.size() > 1 ? "a SYNC on every bus advances the robot by one cycle"
                                                     : "every SYNC advances the robot by one cycle"));
  note_missing_brakes(scenario);
  for (const std::string& bus : a.can.buses())
    if (bus.starts_with("memory:") && !a.realtime)
      report_nonblocking(
          fmt::format("note: {} is a bus in this process: no master can reach it and send a SYNC, so the "
                      "robot stands still; --realtime moves it with the clock\n",
                      bus));
}

/// What looks at the session while it runs: the status line, and the page if one is asked for.
struct Viewers {
  bool line;
  std::unique_ptr<twin::live::Server> server;
  std::optional<BenchFeed> feed;

  Viewers(const Arguments& a, const twin::Scenario& scenario)
      : line(!a.quiet && isatty(STDERR_FILENO)), server(a.web.start(hello_of(scenario), a.results())) {
    if (server) feed.emplace(*server, scenario, !a.record.empty() || !a.output.empty());
  }
  static twin::live::Hello hello_of(const twin::Scenario& scenario) {
    auto hello = twin::live::hello_of(scenario, "drive", TRIBOTWIN_VERSION);
    BenchFeed::add_commands(hello);
    return hello;
  }
  std::function<void(const twin::Twin&, double)> sample() {
    if (!feed) return {};
    return [this](const twin::Twin& twin, double time_s) { feed->sample(twin, time_s); };
  }
  std::function<void(const SessionStatus&)> status() {
    if (!feed && !line) return {};
    return [this](const SessionStatus& status) {
      if (line) show(status);
      if (feed) feed->status(status);
    };
  }
  SessionEvents events() { return feed ? feed->events() : SessionEvents(); }
  void note(const std::string& what) {
    report_nonblocking(fmt::format("{}note: {}\n", line ? "\r\033[K" : "", what));
    if (feed) feed->note(what);
  }
};

int run(const Arguments& a) {
  const twin::Scenario scenario = a.load();
  const Wiring wiring = a.can.wiring(scenario);
  const int drives = static_cast<int>(scenario.model->drives().size());
  a.check_files(scenario);
  if (a.bit_rate)
    for (std::size_t bus = 0; bus < bus_count(wiring); ++bus) a.check_bus_load(scenario, *a.bit_rate, wiring, bus);
  std::vector<Fault> faults;
  if (!a.faults.empty()) faults = twin::or_wrong_input(load_faults(a.faults, a.first_node, drives, wiring));
  const auto conditions = a.start.conditions();
  const auto nodes = node_setups(scenario, a, conditions, Use::live, wiring);
  twin::catch_interrupts();
  Viewers viewers(a, scenario);
  const auto buses = open_buses(a, scenario, wiring);
  std::vector<Transport*> opened;
  for (const auto& bus : buses) opened.push_back(bus.get());
  if (!a.quiet) announce(a, scenario, wiring);
  std::function<void(const std::string&)> show_statistics;
  if (a.json) show_statistics = twin::print_text;
  const auto ended = hil::drive(scenario, opened,
                                {.profile = a.bench_profile(),
                                 .first_node = a.first_node,
                                 .wiring = wiring,
                                 .cycle_us = a.cycle_us(),
                                 .nodes = nodes,
                                 .conditions = conditions,
                                 .realtime = a.realtime,
                                 .duration_s = a.duration,
                                 .bit_rate = a.bit_rate,
                                 .record = a.record,
                                 .statistics = a.stats,
                                 .show_statistics = show_statistics,
                                 .output = a.output,
                                 .existing = twin::replace_if(a.force),
                                 .faults = faults,
                                 .stop = stop,
                                 .status = viewers.status(),
                                 .sample = viewers.sample(),
                                 .note = [&](const std::string& what) { viewers.note(what); },
                                 .events = viewers.events()});
  if (viewers.line) report_nonblocking("\n");
  twin::or_throw(ended);
  return twin::done;
}

}  // namespace

void add_drive(CLI::App& app, int& code) {
  declare(app, code, "drive", "Simulate the drives of a robot, one per joint", run);
}

}  // namespace tribotwin::hil::program
