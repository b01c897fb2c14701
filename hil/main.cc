// tribotwin-hil: drives on a CAN bus. stdout carries results only; everything else goes to stderr.
#include <cmath>
#include <csignal>
#include <cstdio>
#include <deque>

#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <unistd.h>

#include <tribotwin/hil/can/clock.hpp>
#include <tribotwin/hil/can/log.hpp>
#include <tribotwin/hil/canopen/budget.hpp>
#include <tribotwin/hil/mirror/mirror.hpp>
#include <tribotwin/hil/session/session.hpp>
#include <tribotwin/hil/session/shadow.hpp>
#include <tribotwin/twin/output/file.hpp>
#include <tribotwin/twin/output/output.hpp>
#include <tribotwin/twin/scenario/input.hpp>

namespace {

using namespace tribotwin;
namespace fs = std::filesystem;
using twin::complain, twin::done, twin::failed, twin::wrong_input, twin::InputError;

constexpr const char* program = "tribotwin-hil";
volatile std::sig_atomic_t interrupted = 0;

struct Common {
  std::string scenario;
  std::vector<std::string> settings;
  int first_node = 1;
  double cycle_ms = 2;
  std::string profile = "cia402";

  void add_to(CLI::App& command) {
    command.add_option("SCENARIO", scenario, "Scenario file: model, start, surroundings and events; its motion is the master's business")->required();
    command.add_option("--set", settings, "key=value, dotted keys, in place of what the file says")->allow_extra_args(false);
    command.add_option("--first-node", first_node, "Node number of the first drive; the others count up")->check(CLI::Range(1, 127))->capture_default_str();
    command.add_option("--cycle", cycle_ms, "SYNC period [ms] (1006h)")->check(CLI::Range(0.1, 1000.0))->capture_default_str();
  }
  void add_profile(CLI::App& command) {
    command.add_option("--profile", profile, "What is spoken: CANopen with CiA 402, or two plain frames per drive (see dbc)")->check(CLI::IsMember({"cia402", "mirror"}))->capture_default_str();
  }
  bool mirror() const { return profile == "mirror"; }
  hil::Profile speaks() const { return mirror() ? hil::Profile::mirror : hil::Profile::cia402; }
  twin::Scenario load() const {
    twin::Scenario s = twin::load_scenario(scenario, settings);
    if (first_node + s.model->drives().size() - 1 > 127)
      throw InputError(fmt::format("--first-node {}: {} drives need node numbers up to {}; at most 127", first_node, s.model->drives().size(), first_node + s.model->drives().size() - 1));
    return s;
  }
  hil::Budget budget(const twin::Scenario& scenario, double bit_rate) const;
  std::uint32_t cycle_us() const { return static_cast<std::uint32_t>(std::lround(1e3 * cycle_ms)); }
};

/// The drives of a scenario as the bus sees them before a master changes anything.
class Drives {
 public:
  Drives(const twin::Scenario& scenario, const Common& c) : parameters_(hil::drive_parameters(scenario, c.first_node, c.cycle_us())) {
    for (const auto& p : parameters_) dictionaries_.emplace_back(p);
    for (std::size_t i = 0; i < parameters_.size(); ++i) described_.push_back({&dictionaries_[i], &parameters_[i]});
  }
  std::span<const hil::DescribedDrive> all() const { return described_; }

 private:
  std::vector<hil::DriveParameters> parameters_;
  std::deque<hil::Dictionary> dictionaries_;
  std::vector<hil::DescribedDrive> described_;
};

hil::Budget Common::budget(const twin::Scenario& scenario, double bit_rate) const {
  if (mirror()) return hil::budget_of_frames(static_cast<int>(scenario.model->drives().size()), 1e-3 * cycle_ms, bit_rate);
  return hil::budget(Drives(scenario, *this).all(), 1e-3 * cycle_ms, bit_rate);
}

int print(std::string_view text, const std::string& file) {
  if (file.empty()) {
    std::fwrite(text.data(), 1, text.size(), stdout);
    return std::fflush(stdout) == 0 ? done : complain(program, failed, "stdout cannot be written");
  }
  const auto written = twin::write_file(file, text, twin::Existing::replace);
  return written ? done : complain(program, failed, written.error());
}

void status_line(const hil::SessionStatus& s) {
  std::string drives;
  double hottest = -1e9;
  for (std::size_t i = 0; i < s.bench->drives().size(); ++i) {
    const auto& drive = *s.bench->drives()[i];
    drives += drive.enabled() ? 'E' : drive.failed() ? 'F' : drive.brake_engaged() ? '-' : '+';
    hottest = std::max(hottest, s.bench->plant().twin().temperature_degC(i));
  }
  fmt::print(stderr, "\r\033[K{:.1f} s, {} syncs, bus {:.0f} %, drives {} (E enabled, F fault), hottest {:.1f} degC, lost {}, {}", s.simulated_s, s.bench->counters().syncs, 100 * s.bus_load, drives,
             hottest, s.bus->counters().receive_lost + s.bus->counters().send_busy + s.bus->counters().send_down, s.bus->state());
  std::fflush(stderr);
}

struct DriveArguments : Common {
  std::string can, record, stats, output, faults;
  std::optional<double> duration;
  bool realtime = false, lockstep = false, quiet = false;
};

/// Whoever was on the bus will not say it again: no session takes the place of one recorded before.
void refuse_recorded(const fs::path& file) {
  std::error_code none;
  if (fs::is_regular_file(file, none) && fs::file_size(file, none) > 0)
    throw InputError(fmt::format("{}: holds a session already; give another name, or move that one away", file.string()));
}

int run_drives(const DriveArguments& a) {
  const twin::Scenario scenario = a.load();
  if (!a.record.empty()) refuse_recorded(a.record);
  if (!a.output.empty()) refuse_recorded(fs::path(a.output) / "telemetry.h5");
  const hil::Budget budget = a.budget(scenario, 1e6);
  if (budget.most > 1) throw InputError(fmt::format("--cycle {}: {}; choose a longer cycle or fewer drives on one bus", a.cycle_ms, budget.line()));
  if (budget.most > 0.8) fmt::print(stderr, "note: {}\n", budget.line());
  std::vector<hil::Fault> faults;
  if (!a.faults.empty()) faults = hil::load_faults(a.faults, a.first_node, static_cast<int>(scenario.model->drives().size()));
  auto bus = hil::open_bus(a.can);
  if (!bus) throw InputError(bus.error().message);
  const bool live = !a.quiet && isatty(STDERR_FILENO);
  if (!a.quiet)
    fmt::print(stderr, "{} drives, nodes {} to {}, on {}; {}\n", scenario.model->drives().size(), a.first_node, a.first_node + static_cast<int>(scenario.model->drives().size()) - 1, (*bus)->name(),
               a.realtime ? "the robot moves with the clock" : "every SYNC moves the robot on by one cycle");
  const auto ended = hil::drive(scenario, **bus,
                                {.profile = a.speaks(), .first_node = a.first_node, .cycle_us = a.cycle_us(), .realtime = a.realtime, .duration_s = a.duration, .record = a.record, .statistics = a.stats, .output = a.output, .faults = faults,
                                 .stop = [] { return interrupted != 0; }, .status = live ? status_line : std::function<void(const hil::SessionStatus&)>{},
                                 .note = [&](const std::string& what) { fmt::print(stderr, "{}note: {}\n", live ? "\r\033[K" : "", what); }});
  if (live) fmt::print(stderr, "\n");
  return ended ? done : complain(program, failed, ended.error());
}

struct ReplayArguments : Common {
  std::string log, output;
  double rate = 1;
  bool fast = false;
};

int replay(const ReplayArguments& a) {
  const twin::Scenario scenario = a.load();
  if (!fs::exists(a.log)) throw InputError(fmt::format("{}: does not exist", a.log));
  const auto result = hil::replay(scenario, a.log, {.profile = a.speaks(), .first_node = a.first_node, .cycle_us = a.cycle_us(), .rate = a.fast ? 0 : a.rate, .output = a.output, .stop = [] { return interrupted != 0; }});
  if (!result) return complain(program, failed, result.error());
  fmt::print("{} frames, {} from the drives: {} differ, {} missing\n", result->frames, result->compared, result->differing, result->missing);
  if (result->first_difference.empty()) return done;
  return complain(program, failed, result->first_difference);
}

struct ShadowArguments : Common {
  std::string can, csv;
  std::optional<double> limit, duration;
  double limit_time = 0.5;
  bool quiet = false;
};

int run_shadow(const ShadowArguments& a) {
  const twin::Scenario scenario = a.load();
  hil::NextFrame next;
  std::unique_ptr<hil::Transport> bus;
  std::optional<hil::LogReader> log;
  if (a.can.starts_with("log:")) {
    auto reader = hil::LogReader::open(a.can.substr(4));
    if (!reader) throw InputError(reader.error());
    log.emplace(std::move(*reader));
    next = [&](hil::Frame& frame) { return log->next(frame); };
  } else {
    auto opened = hil::open_bus(a.can, {.listen_only = true});
    if (!opened) throw InputError(opened.error().message);
    bus = std::move(*opened);
    next = [&](hil::Frame& frame) -> tl::expected<bool, std::string> {
      while (!interrupted) {
        if (bus->receive(frame)) return true;
        bus->wait(hil::clock_ns() + 100'000'000);
      }
      return false;
    };
  }
  const auto result = hil::shadow(scenario, next,
                                  {.profile = a.speaks(), .first_node = a.first_node, .cycle_us = a.cycle_us(), .limit_nm = a.limit, .limit_time_s = a.limit_time,
                                   .duration_s = a.duration, .csv = a.csv, .stop = [] { return interrupted != 0; }, .note = [&](const std::string& what) { fmt::print(stderr, "{}\n", what); }});
  if (!result) return complain(program, failed, result.error());
  fmt::print("{}", result->table());
  return result->exceeded() ? twin::limit_exceeded : done;
}

}  // namespace

int main(int argc, char** argv) {
  mujoco::install_message_handlers();
  std::signal(SIGXFSZ, SIG_IGN);
  std::signal(SIGPIPE, SIG_IGN);
  for (const int signal : {SIGINT, SIGTERM}) std::signal(signal, [](int) { interrupted = 1; });

  CLI::App app{"tribotwin-hil: the joints of a robot as drives on a CAN bus"};
  app.require_subcommand(1);
  app.set_version_flag("--version", std::string("tribotwin-hil " TRIBOTWIN_VERSION ", MuJoCo ") + mj_versionString());

  DriveArguments d;
  auto* drive_command = app.add_subcommand("drive", "Be the drives of a robot, one per joint");
  d.add_to(*drive_command);
  d.add_profile(*drive_command);
  drive_command->add_option("--can", d.can, "Bus: vcan0, can0, socketcand://127.0.0.1:29536/NAME")->required();
  auto* realtime = drive_command->add_flag("--realtime", d.realtime, "The robot moves with the clock");
  drive_command->add_flag("--sync-lockstep", d.lockstep, "Every SYNC moves the robot on by one cycle (default)")->excludes(realtime);
  drive_command->add_option("--duration", d.duration, "End after so much simulated time [s]")->check(CLI::PositiveNumber);
  drive_command->add_option("--record", d.record, "Everything on the bus as a candump log");
  drive_command->add_option("--stats", d.stats, "Counters of the session as JSON");
  drive_command->add_option("--faults", d.faults, "Faults on purpose: a YAML list (hil/README.md)");
  drive_command->add_option("-o,--output", d.output, "Folder for telemetry.h5, scenario.yaml, summary.json");
  drive_command->add_flag("--quiet", d.quiet, "No status line");
  drive_command->footer("Example:\n  tribotwin-hil drive twin/scenarios/irb6620_hold.yaml --can socketcand://127.0.0.1:29536/can0 --duration 10");

  ReplayArguments r;
  auto* replay_command = app.add_subcommand("replay", "A recorded session through the same drives, compared with what they said then");
  r.add_to(*replay_command);
  r.add_profile(*replay_command);
  replay_command->add_option("LOG", r.log, "candump log, as --record writes it")->required();
  auto* rate = replay_command->add_option("--rate", r.rate, "Speed: 1 is the original")->check(CLI::PositiveNumber)->capture_default_str();
  replay_command->add_flag("--fast", r.fast, "As fast as possible")->excludes(rate);
  replay_command->add_option("-o,--output", r.output, "Folder for telemetry.h5, scenario.yaml, summary.json");
  replay_command->footer("Example:\n  tribotwin-hil replay twin/scenarios/irb6620_hold.yaml session.log --fast");

  ShadowArguments w;
  auto* shadow_command = app.add_subcommand("shadow", "Listen beside a robot: what torque and temperature it should have");
  w.add_to(*shadow_command);
  w.add_profile(*shadow_command);
  shadow_command->add_option("--can", w.can, "Bus: vcan0, can0, or log:FILE for a candump log")->required();
  shadow_command->add_option("--limit", w.limit, "Largest residual torque, arm side [Nm]; beyond it: exit code 3")->check(CLI::PositiveNumber);
  shadow_command->add_option("--limit-time", w.limit_time, "... for so long [s]")->check(CLI::NonNegativeNumber)->capture_default_str();
  shadow_command->add_option("--duration", w.duration, "End after so much time on the bus [s]")->check(CLI::PositiveNumber);
  shadow_command->add_option("--csv", w.csv, "Measured, predicted, residual and temperature of every cycle");
  shadow_command->footer("Example:\n  tribotwin-hil shadow twin/scenarios/irb6620_hold.yaml --can log:session.log --limit 200");

  Common b;
  double bit_rate = 1e6;
  auto* budget_command = app.add_subcommand("budget", "The load of the bus, before anything runs");
  b.add_to(*budget_command);
  b.add_profile(*budget_command);
  budget_command->add_option("--bit-rate", bit_rate, "[bit/s]")->check(CLI::Range(1e4, 1e6))->capture_default_str();
  budget_command->footer("Example:\n  tribotwin-hil budget twin/scenarios/irb6620_hold.yaml --cycle 2");

  Common e;
  std::string file;
  int node = 0;
  auto* eds_command = app.add_subcommand("eds", "The electronic data sheet of a drive");
  e.add_to(*eds_command);
  eds_command->add_option("--node", node, "Of this node (default: the first)");
  eds_command->add_option("-o,--output", file, "File to write (default: stdout)");
  eds_command->footer("Example:\n  tribotwin-hil eds twin/scenarios/irb6620_hold.yaml -o drive.eds");
  auto* dbc_command = app.add_subcommand("dbc", "All cyclic frames of all drives as a DBC");
  e.add_to(*dbc_command);
  e.add_profile(*dbc_command);
  dbc_command->add_option("-o,--output", file, "File to write (default: stdout)");
  dbc_command->footer("Example:\n  tribotwin-hil dbc twin/scenarios/irb6620_hold.yaml -o drives.dbc");

  try {
    app.parse(argc, argv);
    if (*drive_command) return run_drives(d);
    if (*replay_command) return replay(r);
    if (*shadow_command) return run_shadow(w);
    if (*budget_command) {
      const twin::Scenario scenario = b.load();
      const hil::Budget budget = b.budget(scenario, bit_rate);
      fmt::print("{}\n", budget.line());
      if (budget.most > 1) return complain(program, wrong_input, "more than the bus can carry; choose a longer cycle or fewer drives on one bus");
      if (budget.most > 0.8) fmt::print(stderr, "note: more than 80 % at worst; other traffic will not fit\n");
      return done;
    }
    const twin::Scenario scenario = e.load();
    const Drives drives(scenario, e);
    if (*dbc_command && e.mirror()) {
      std::vector<hil::DescribedMirror> all;
      for (const auto& d : drives.all()) all.push_back({d.parameters->node, d.parameters->name, d.parameters->rated_torque_nm * d.parameters->gear_ratio});
      return print(hil::mirror_dbc(all), file);
    }
    if (*dbc_command) return print(hil::dbc(drives.all()), file);
    for (const auto& described : drives.all())
      if (node == 0 || described.parameters->node == node) return print(hil::eds(*described.dictionary, *described.parameters), file);
    throw InputError(fmt::format("--node {}: the drives are nodes {} to {}", node, e.first_node, e.first_node + static_cast<int>(drives.all().size()) - 1));
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? done : wrong_input;
  } catch (const InputError& error) {
    return complain(program, wrong_input, error.what());
  } catch (const std::exception& error) {
    return complain(program, failed, error.what());
  }
}
