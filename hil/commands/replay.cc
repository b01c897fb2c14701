#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include <tribotwin/hil/commands/can_options.hpp>
#include <tribotwin/hil/commands/node_options.hpp>
#include <tribotwin/hil/live/bench_feed.hpp>
#include <tribotwin/hil/session/replay.hpp>
#include <tribotwin/hil/session/session_file.hpp>
#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/live/web_options.hpp>

namespace tribotwin::hil::program {
namespace {

using twin::failed, twin::wrong_input;

struct Arguments : RobotOptions {
  NodeOptions start;
  CanOptions can;
  std::string log, output;
  double rate = 1;
  bool fast = false, force = false, json = false;
  twin::live::WebOptions web;

  void add_to(CLI::App& command) {
    RobotOptions::add_to(command);
    add_profile(command);
    start.add_to(command);
    can.add_to(command, "Channel of the log, where no LOG.session tells; any without");
    command.add_option("LOG", log, "candump log, as --record writes it")->required();
    auto* speed = command.add_option("--speed-factor,--rate", rate, "Speed of the replay; 1 is the original")
                      ->check(CLI::PositiveNumber)
                      ->capture_default_str();
    command.add_flag("--fast", fast, "As fast as possible")->excludes(speed);
    command.add_option("-o,--output", output, "Folder for telemetry.h5, scenario.yaml, summary.json");
    add_force(command, force);
    web.add_to(command);
    command.add_flag("--json", json, "Print JSON instead of text");
    command.footer(
        "Example:\n  tribotwin-hil drive irb6620_hold --can socketcand://127.0.0.1:29536/can0 --realtime --duration 10 "
        "--record session.log\n  tribotwin-hil replay irb6620_hold session.log --fast");
  }
};

std::string json_of(const ReplayResult& r) {
  const nlohmann::ordered_json json{{"frames", r.frames},
                                    {"compared", r.compared},
                                    {"differing", r.differing},
                                    {"missing", r.missing},
                                    {"added", r.added},
                                    {"silent", r.silent},
                                    {"interrupted", r.interrupted},
                                    {"first_difference", r.first_difference}};
  return twin::dump_json(json, 2) + "\n";
}

/// The exit code of a replay that came to an end; says why it is not 0.
int judge(const Arguments& a, const ReplayResult& result) {
  if (result.interrupted)
    return report_error(
        failed, fmt::format("interrupted after {} frames; {}", result.frames,
                            result.first_difference.empty() ? "no difference so far" : result.first_difference));
  if (result.frames == 0)
    return report_error(wrong_input, fmt::format("{}: holds no frame; nothing was compared", a.log));
  if (!result.silent.empty())
    return report_error(wrong_input,
                        fmt::format("{}: no frame from the drive of {}; nothing was compared there: is --first-node {} "
                                    "right, and --profile {}?",
                                    a.log, fmt::join(result.silent, ", "), a.first_node, a.profile));
  if (!result.first_difference.empty())
    return report_error(failed, result.session_file ? result.first_difference
                                                    : fmt::format("{}; there is no {}.session, without which a session "
                                                                  "with --realtime or --faults does not repeat",
                                                                  result.first_difference, a.log));
  if (!result.cut.empty()) return report_error(failed, result.cut);
  return twin::done;
}

/// Those that were recorded; of a log without them, those of the options.
StartConditions conditions(const Arguments& a, const twin::Scenario& scenario, const Wiring& wiring) {
  const auto given = a.start.conditions();
  const auto recorded = recorded_conditions(a.log);
  if (!recorded) return given;
  if (given != StartConditions{}) node_setups(scenario, a, given, Use::replay, wiring);  // what is given must be right
  check_same(given, *recorded, a.log);
  return *recorded;
}

/// A page shows it at the speed of the replay. The record says what happens: a page may only mark.
struct Page {
  std::unique_ptr<twin::live::Server> server;
  std::optional<BenchFeed> feed;

  Page(const Arguments& a, const twin::Scenario& scenario) {
    auto hello = twin::live::hello_of(scenario, "replay", TRIBOTWIN_VERSION);
    hello.commands = {"marker"};
    server = a.web.start(std::move(hello), a.output);
    if (server) feed.emplace(*server, scenario, !a.output.empty());
  }
  void show_in(ReplayOptions& options) {
    if (!feed) return;
    options.status = [this](const SessionStatus& status) { feed->status(status); };
    options.sample = [this](const twin::Twin& twin, double time_s) { feed->sample(twin, time_s); };
    options.note = [this](const std::string& what) { feed->note(what); };
    options.events = feed->events();
  }
};

int run(const Arguments& a) {
  const twin::Scenario scenario = a.load();
  if (!std::filesystem::exists(a.log)) throw twin::InputError(fmt::format("{}: does not exist", a.log));
  const Wiring wiring = a.can.given.empty() ? wiring_of_log(scenario, a.log) : a.can.wiring(scenario);
  auto inputs = files_of(scenario);
  inputs.push_back({"LOG " + a.log, a.log});
  for (const auto& files : {a.start.outputs(), a.start.inputs()})  // a replay does not write the store
    inputs.insert(inputs.end(), files.begin(), files.end());
  inputs.push_back({"the file beside LOG " + a.log, session_file_of(a.log)});
  check_outputs(inputs, files_in(a.output), a.force);
  const auto nodes = node_setups(scenario, a, conditions(a, scenario, wiring), Use::replay, wiring);
  twin::catch_interrupts();
  Page page(a, scenario);
  ReplayOptions options{.profile = a.bench_profile(),
                        .first_node = a.first_node,
                        .wiring = wiring,
                        .channels = a.can.buses(),
                        .cycle_us = a.cycle_us(),
                        .nodes = nodes,
                        .rate = a.fast ? 0 : a.rate,
                        .output = a.output,
                        .existing = twin::replace_if(a.force),
                        .stop = stop};
  page.show_in(options);
  const auto result = twin::or_throw(hil::replay(scenario, a.log, options));
  if (a.json)
    twin::print_text(json_of(result));
  else
    twin::print("{} frames, {} from the drives: {} differ, {} missing, {} added\n", result.frames, result.compared,
                result.differing, result.missing, result.added);
  return judge(a, result);
}

}  // namespace

void add_replay(CLI::App& app, int& code) {
  declare(app, code, "replay", "Replay a recorded session through the same drives and compare their frames", run);
}

}  // namespace tribotwin::hil::program
