#include <algorithm>

#include <fmt/format.h>
#include <unistd.h>

#include <tribotwin/hil/commands/node_options.hpp>
#include <tribotwin/hil/session/drive.hpp>
#include <tribotwin/twin/io/interrupt.hpp>

namespace tribotwin::hil::program {
namespace {

using twin::InputError;

struct Arguments : RobotOptions {
  NodeOptions start;
  std::string can, record, stats, output, faults;
  std::optional<double> duration;
  bool realtime = false, lockstep = false, quiet = false, force = false;

  void add_to(CLI::App& command) {
    RobotOptions::add_to(command);
    add_profile(command);
    start.add_to(command);
    command.add_option("--can", can, "Bus: vcan0, can0, socketcand://127.0.0.1:29536/NAME")->required();
    auto* clock = command.add_flag("--realtime", realtime, "The robot moves with the clock");
    command.add_flag("--sync-lockstep", lockstep, "Every SYNC advances the robot by one cycle (default)")
        ->excludes(clock);
    command.add_option("--duration", duration, "Simulated time after which the session ends [s]")
        ->check(CLI::PositiveNumber);
    command.add_option("--record", record, "Everything on the bus as a candump log");
    command.add_option("--stats", stats, "Counters of the session as JSON");
    command.add_option("--faults", faults, "Injected faults: a YAML list (hil/README.md)");
    command.add_option("-o,--output", output, "Folder for telemetry.h5, scenario.yaml, summary.json");
    add_force(command, force);
    command.add_flag("--quiet", quiet, "No status line");
    command.footer(
        "Example:\n  tribotwin-hil drive twin/scenarios/irb6620_hold.yaml --can socketcand://127.0.0.1:29536/can0 "
        "--duration 10");
  }

  void check_files(const twin::Scenario& robot) const {
    auto inputs = files_of(robot);
    inputs.push_back({"--faults " + faults, faults});
    auto outputs = files_in(output);
    outputs.push_back({"--record " + record, record});
    outputs.push_back({"--stats " + stats, stats});
    const auto kept = start.files();
    check_outputs(inputs, outputs, force);
    outputs.insert(outputs.end(), kept.begin(), kept.end());
    twin::or_wrong_input(refuse_shared(inputs, outputs));  // a store may exist
    for (const auto& file : kept) twin::or_wrong_input(twin::check_output(file.path, twin::Existing::replace));
    for (const auto& file : {record, stats})
      if (!file.empty()) twin::or_wrong_input(twin::check_output(file, twin::Existing::replace));
    if (!stats.empty()) twin::or_wrong_input(twin::check_output(stats, twin::replace_if(force)));
  }

  /// Throws InputError where the bus cannot carry the drives.
  void check_bus_load(const twin::Scenario& robot) const {
    const Budget load = budget(robot, 1e6);
    if (load.max > 1)
      throw InputError(
          fmt::format("--cycle {}: {}; choose a longer cycle or fewer drives on one bus", cycle_ms, load.line()));
    if (load.max > 0.8) twin::note("{}", load.line());
  }
};

void status_line(const SessionStatus& s) {
  std::string drives;
  double hottest_degC = -1e9;
  for (std::size_t i = 0; i < s.bench->drives().size(); ++i) {
    const auto& drive = *s.bench->drives()[i];
    drives += drive.enabled() ? 'E' : drive.failed() ? 'F' : drive.brake_engaged() ? '-' : '+';
    hottest_degC = std::max(hottest_degC, s.bench->plant().twin().temperature_degC(i));
  }
  const BusCounters& bus = s.bus->counters();
  report_nonblocking(fmt::format(
      "\r\033[K{:.1f} s, {} syncs, bus {:.0f} %, drives {} (E enabled, F fault), hottest {:.1f} degC, lost {}, {}",
      s.simulated_s, s.bench->counters().syncs, 100 * s.bus_load, drives, hottest_degC,
      bus.receive_lost + bus.send_busy + bus.send_down, s.bus->state()));
}

int run(const Arguments& a) {
  const twin::Scenario scenario = a.load();
  const int drives = static_cast<int>(scenario.model->drives().size());
  a.check_files(scenario);
  a.check_bus_load(scenario);
  std::vector<Fault> faults;
  if (!a.faults.empty()) faults = twin::or_wrong_input(load_faults(a.faults, a.first_node, drives));
  const auto nodes = a.start.setups(scenario, a, NodeOptions::Use::live);
  twin::catch_interrupts();
  const auto bus = twin::or_wrong_input(open_bus(a.can));
  const bool live = !a.quiet && isatty(STDERR_FILENO);
  if (!a.quiet)
    report_nonblocking(fmt::format(
        "{} drives, nodes {} to {}, on {}; {}\n", drives, a.first_node, a.first_node + drives - 1, bus->name(),
        a.realtime ? "the robot moves with the clock" : "every SYNC advances the robot by one cycle"));
  const auto ended = hil::drive(scenario, *bus,
                                {.profile = a.bench_profile(),
                                 .first_node = a.first_node,
                                 .cycle_us = a.cycle_us(),
                                 .nodes = nodes,
                                 .realtime = a.realtime,
                                 .duration_s = a.duration,
                                 .record = a.record,
                                 .statistics = a.stats,
                                 .output = a.output,
                                 .existing = twin::replace_if(a.force),
                                 .faults = faults,
                                 .stop = stop,
                                 .status = live ? status_line : std::function<void(const SessionStatus&)>{},
                                 .note = [&](const std::string& what) {
                                   report_nonblocking(fmt::format("{}note: {}\n", live ? "\r\033[K" : "", what));
                                 }});
  if (live) report_nonblocking("\n");
  twin::or_throw(ended);
  return twin::done;
}

}  // namespace

void add_drive(CLI::App& app, int& code) {
  declare(app, code, "drive", "Simulate the drives of a robot, one per joint", run);
}

}  // namespace tribotwin::hil::program
