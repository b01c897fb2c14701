#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/hil/can/clock.hpp>
#include <tribotwin/hil/can/log.hpp>
#include <tribotwin/hil/can/transport.hpp>
#include <tribotwin/hil/commands/can_options.hpp>
#include <tribotwin/hil/commands/shadow_feed.hpp>
#include <tribotwin/hil/session/session_file.hpp>
#include <tribotwin/hil/shadow/foreign_drives.hpp>
#include <tribotwin/hil/shadow/shadow.hpp>
#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/live/web_options.hpp>

namespace tribotwin::hil::program {
namespace {

using twin::failed, twin::wrong_input;

struct Arguments : RobotOptions {
  std::string can, csv;
  std::optional<double> limit, duration;
  double limit_time = 0.5;
  std::vector<std::string> joints;
  bool force = false, json = false, lockstep = false;
  ForeignDrives foreign;
  twin::live::WebOptions web;

  void add_to(CLI::App& command) {
    RobotOptions::add_to(command);
    add_profile(command);
    command.add_flag("--lockstep", lockstep,
                     "The SYNC is the clock, each one --cycle; else --cycle is only checked against the bus");
    command.add_option("--can", can, "Bus: vcan0, can0, or log:FILE for a candump log")->required();
    auto* maps = command
                     .add_option("--map", foreign.maps,
                                 "[JOINT=]FILE: drives of another maker, from their DBC (with --signal), EDS or DCF; "
                                 "again for more")
                     ->allow_extra_args(false);
    command.add_option("--signal", foreign.signals, std::string(signal_syntax) + "; again for more")
        ->allow_extra_args(false)
        ->needs(maps);
    command
        .add_option("--increments", foreign.increments,
                    "Counts of 6064h per motor turn; default: 608Fh of the EDS or DCF")
        ->check(CLI::PositiveNumber)
        ->needs(maps);
    command
        .add_flag("--mean-torque", foreign.mean_torque,
                  "Their torques are means since the SYNC before, as of drive; else those at the SYNC")
        ->needs(maps);
    auto* limited =
        command.add_option("--limit", limit, "Largest residual torque, arm side [Nm]; beyond it: exit code 3")
            ->check(CLI::PositiveNumber);
    command.add_option("--limit-time", limit_time, "Time for which the residual must exceed --limit [s]")
        ->check(CLI::NonNegativeNumber)
        ->capture_default_str();
    command.add_option("--joint", joints, "A joint that --limit holds for, by name; again for more (default: all)")
        ->allow_extra_args(false)
        ->needs(limited);
    command.add_option("--duration", duration, "Bus time after which the session ends [s]")->check(CLI::PositiveNumber);
    command.add_option("-o,--output,--csv", csv,
                       "CSV to write: measured, predicted, residual and temperature of every cycle");
    add_force(command, force);
    web.add_to(command);
    command.add_flag("--json", json, "Print JSON instead of the table");
    command.footer(
        "Example:\n  tribotwin-hil shadow twin/scenarios/irb6620_hold.yaml --can log:session.log --limit "
        "200\n\nsession.log is a record of a bus with a master that sends SYNC, by candump -l or tribotwin-hil drive "
        "--record.");
  }

  /// The file behind log:FILE; empty for a bus.
  std::string log() const { return can.starts_with("log:") ? can.substr(4) : ""; }
};

/// Frames of a live bus, until a signal or the end of `duration_s` by the clock: a bus may fall silent. `look` is
/// called ten times a second or more.
NextFrame frames_of(Transport& bus, std::optional<double> duration_s, std::function<void()> look) {
  return [&bus, duration_s, look, heard = false, begin_ns = clock_ns()](Frame& frame) mutable -> Result<bool> {
    while (!stop()) {
      look();
      const std::int64_t now_ns = clock_ns();
      const bool received = bus.receive(frame);
      if (received && !std::exchange(heard, true)) begin_ns = now_ns;
      if (received) return true;
      if (duration_s && 1e-9 * static_cast<double>(now_ns - begin_ns) > *duration_s) return false;
      bus.wait(now_ns + 100'000'000);
    }
    return false;
  };
}

/// A log or a bus, and its frames.
struct Source {
  std::optional<LogReader> log;
  std::unique_ptr<Transport> bus;
  Wiring wiring;
  std::size_t channel = 0;  ///< the bus of the last frame

  Source(const Arguments& a, const Wiring& wired) : wiring(wired) {
    if (!a.log().empty())
      log.emplace(twin::or_wrong_input(LogReader::open(a.log(), stop)));
    else
      bus = twin::or_wrong_input(open_bus(a.can, {.fd = a.fd(), .listen_only = true}));
  }
  NextFrame frames(std::optional<double> duration_s, std::function<void()> look) {
    if (bus) return frames_of(*bus, duration_s, look);
    return [this, look](Frame& frame) {
      look();
      return next(frame);
    };
  }
  std::uint64_t lost() const { return bus ? bus->counters().lost() : 0; }
  /// Of several buses the channels that the session had; others are left out.
  Result<bool> next(Frame& frame) {
    for (;;) {
      auto more = log->next(frame);
      if (!more || !*more || wiring.size() < 2) return more;
      for (channel = 0; channel < wiring.size(); ++channel)
        if (log->bus() == channel_of(channel)) return true;
    }
  }
};

std::string json_of(const ShadowResult& r) {
  nlohmann::ordered_json json{{"seconds", r.seconds},
                              {"cycle_s", r.cycle_s},
                              {"cycle_source", r.cycle_source},
                              {"interrupted", r.interrupted},
                              {"unchecked", r.unchecked}};
  for (const auto& j : r.joints) {
    nlohmann::ordered_json one{{"joint", j.name},
                               {"samples", j.samples},
                               {"judged_from_s", j.judged_from_s},
                               {"judged_to_s", j.judged_to_s},
                               {"not_enabled", j.not_enabled},
                               {"torque_missing", j.torque_missing},
                               {"position_missing", j.position_missing},
                               {"positions_lost", j.positions_lost},
                               {"torques_lost", j.torques_lost}};
    const bool judged = j.samples > 0;  // without any, the residuals are no numbers
    for (const auto& [key, value] : {std::pair{"residual_mean_nm", j.residual_mean_nm},
                                     {"residual_rms_nm", j.residual_rms_nm},
                                     {"residual_max_nm", j.residual_max_nm},
                                     {"lag_s", j.lag_s}})
      one[key] = judged ? nlohmann::ordered_json(value) : nlohmann::ordered_json(nullptr);
    one["temperature_degC"] = j.temperature_degC;
    one["exceeded"] = j.exceeded;
    json["joints"].push_back(std::move(one));
  }
  return twin::dump_json(json, 2) + "\n";
}

/// What the file beside a log says about how it must be read.
void note_session(const Arguments& a, const twin::Scenario& scenario) {
  const auto file = session_file_of(a.log());
  if (a.log().empty() || file.empty() || !std::filesystem::exists(file)) return;
  const auto session = SessionReader::open(file);
  if (!session) return twin::note("{}", session.error().message);
  if (session->head().complete && session->head().scenario != scenario_checksum(scenario))
    twin::note("{}: the log was recorded with another scenario than {}, other --set or in another folder",
               file.string(), scenario.file.string());
  const double cycle_ms = 1e-3 * session->head().cycle_us;
  if (!session->head().realtime && !a.lockstep)
    twin::note(
        "{}: the log is of a session in lockstep, where each SYNC is a cycle of {} ms whatever the time stamps "
        "say; give --lockstep --cycle {}",
        file.string(), cycle_ms, cycle_ms);
  if (session->head().realtime && a.lockstep)
    twin::note("{}: the log is of a session with --realtime; leave --lockstep out", file.string());
  if (!session->head().realtime && a.lockstep && session->head().cycle_us != a.cycle_us())
    twin::note("{}: the log was recorded with --cycle {}, not with --cycle {}", file.string(), cycle_ms, a.cycle_ms);
}

/// The exit code of a session that came to an end: that of the first reason below; says all of them.
int judge(const Arguments& a, const ShadowResult& result) {
  int code = twin::done;
  const auto report = [&](twin::Exit reason, const std::string& what) {
    report_error(reason, what);
    if (code == twin::done) code = reason;
  };
  if (result.exceeded()) code = twin::limit_exceeded;  // reported when it happened
  if (!result.csv_failure.empty()) report(failed, result.csv_failure);
  if (result.interrupted)
    report(failed, fmt::format("interrupted at {:.3f} s{}", result.seconds,
                               a.duration ? fmt::format(" of {} s", *a.duration) : ", before the end of the log"));
  for (const auto& reason : result.unchecked)
    report(wrong_input, fmt::format("--limit {} was not checked: {}", *a.limit, reason));
  return code;
}

/// What looks at the shadow while it listens: the page, if one is asked for.
struct Page {
  std::unique_ptr<twin::live::Server> server;
  std::optional<ShadowFeed> feed;

  Page(const Arguments& a, const twin::Scenario& scenario) {
    if (!a.web.given()) return;
    auto hello = shadow_hello(scenario, TRIBOTWIN_VERSION);
    std::vector<std::string> joints;
    for (const auto& joint : hello.joints) joints.push_back(joint.name);
    server = a.web.start(std::move(hello), std::filesystem::path(a.csv).parent_path());
    feed.emplace(*server, ShadowFeed::Options{a.can, !a.csv.empty(), a.limit, a.joints}, std::move(joints));
  }
  NextFrame frames(Source& source, std::optional<double> duration_s) {
    if (!feed) return source.frames(duration_s, [] {});
    return [this, next = source.frames(duration_s, [this, &source] { feed->look(source.lost()); })](Frame& frame) {
      auto more = next(frame);
      if (more && *more) feed->heard(frame);
      return more;
    };
  }
  std::function<void(const ShadowCycle&)> cycle() {
    if (!feed) return {};
    return [this](const ShadowCycle& cycle) { feed->cycle(cycle); };
  }
  void note(const std::string& what) {
    report_nonblocking(what + "\n");
    if (feed) feed->note(what);
  }
};

int run(const Arguments& a) {
  const twin::Scenario scenario = a.load();
  auto inputs = files_of(scenario);
  inputs.push_back({"--can " + a.can, a.log()});
  for (const auto& file : a.foreign.files()) inputs.push_back({"--map " + file.string(), file});
  check_outputs(inputs, {{"-o " + a.csv, a.csv}}, a.force);
  if (!a.csv.empty()) twin::or_wrong_input(twin::check_output(a.csv, twin::Existing::replace));
  const bool one_bus = a.log().empty() || !recorded_wiring(a.log());  // a damaged session file is only noted
  const Wiring wiring = one_bus ? Wiring{} : wiring_of_log(scenario, a.log());
  ForeignDrives foreign = a.foreign;
  foreign.note = [](const std::string& what) { twin::note("{}", what); };
  auto listeners =
      twin::or_wrong_input(foreign_listeners(foreign, drive_parameters(scenario, a.first_node, a.cycle_us(), wiring)));
  twin::catch_interrupts();
  Page page(a, scenario);
  Source source(a, wiring);
  note_session(a, scenario);
  const auto result = twin::or_throw(hil::shadow(scenario, page.frames(source, a.duration),
                                                 {.profile = a.bench_profile(),
                                                  .first_node = a.first_node,
                                                  .wiring = wiring,
                                                  .bus = [&] { return source.channel; },
                                                  .cycle_us = a.cycle_us(),
                                                  .cycle_expected = a.cycle_option->count() > 0,
                                                  .lockstep = a.lockstep,
                                                  .listeners = [&] { return std::move(listeners); },
                                                  .limit_nm = a.limit,
                                                  .limit_time_s = a.limit_time,
                                                  .limit_joints = a.joints,
                                                  .duration_s = a.duration,
                                                  .csv = a.csv,
                                                  .existing = twin::replace_if(a.force),
                                                  .stop = stop,
                                                  .endless = source.bus && !a.duration,
                                                  .note = [&](const std::string& what) { page.note(what); },
                                                  .cycle = page.cycle()}));
  if (page.feed) page.feed->tell(source.lost());
  twin::print_text(a.json ? json_of(result) : result.table());
  if (source.log && a.duration && !result.interrupted && result.heard_s < *a.duration)
    twin::note("{}: ends after {:.3f} s, before the {} s of --duration", a.log(), result.heard_s, *a.duration);
  return judge(a, result);
}

}  // namespace

void add_shadow(CLI::App& app, int& code) {
  declare(app, code, "shadow", "Listen to a robot and predict its torque and temperature", run);
}

}  // namespace tribotwin::hil::program
