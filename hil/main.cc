// tribotwin-hil: drives on a CAN bus. stdout carries results only; everything else goes to stderr.
#include <cmath>
#include <deque>
#include <sstream>

#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <poll.h>
#include <unistd.h>

#include <tribotwin/hil/can/clock.hpp>
#include <tribotwin/hil/can/log.hpp>
#include <tribotwin/hil/canopen/budget.hpp>
#include <tribotwin/hil/canopen/dbc.hpp>
#include <tribotwin/hil/canopen/eds.hpp>
#include <tribotwin/hil/cia402/drive_objects.hpp>
#include <tribotwin/hil/mirror/mirror.hpp>
#include <tribotwin/hil/session/files.hpp>
#include <tribotwin/hil/session/session.hpp>
#include <tribotwin/hil/session/shadow.hpp>
#include <tribotwin/twin/io/destination.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/io/output.hpp>

namespace {

using namespace tribotwin;
namespace fs = std::filesystem;
using twin::report_error, twin::done, twin::failed, twin::wrong_input, twin::InputError;

constexpr const char* program = "tribotwin-hil";
bool stop() { return twin::interrupted(); }

/// For a session: lost where nobody takes it now, because a bus does not wait for a terminal that is held or a reader
/// that stopped.
void tell(const std::string& text) {
  pollfd reader{STDERR_FILENO, POLLOUT, 0};
  if (::poll(&reader, 1, 0) > 0) twin::report_text(text);
}

struct Common {
  std::string scenario;
  std::vector<std::string> settings;
  int first_node = 1;
  double cycle_ms = 2;
  std::string profile = "cia402";

  void add_to(CLI::App& command) {
    command
        .add_option("SCENARIO", scenario,
                    "Scenario file: model, start, surroundings and events; its motion is the master's business")
        ->required();
    command.add_option("--set", settings, "key=value, dotted keys, in place of what the file says")
        ->allow_extra_args(false);
    command.add_option("--first-node", first_node, "Node number of the first drive; the others count up")
        ->check(CLI::Range(1, 127))
        ->capture_default_str();
    command.add_option("--cycle", cycle_ms, "SYNC period [ms] (1006h)")
        ->check(CLI::Range(0.1, 1000.0))
        ->capture_default_str();
  }
  void add_profile(CLI::App& command) {
    command
        .add_option("--profile", profile,
                    "What is spoken: CANopen with CiA 402, or two plain frames per drive (see dbc)")
        ->check(CLI::IsMember({"cia402", "mirror"}))
        ->capture_default_str();
  }
  bool mirror() const { return profile == "mirror"; }
  hil::Profile speaks() const { return mirror() ? hil::Profile::mirror : hil::Profile::cia402; }
  twin::Scenario load() const {
    twin::Scenario s = twin::or_wrong_input(twin::load_scenario(scenario, settings));
    if (first_node + s.model->drives().size() - 1 > 127)
      throw InputError(fmt::format("--first-node {}: {} drives need node numbers up to {}; at most 127", first_node,
                                   s.model->drives().size(), first_node + s.model->drives().size() - 1));
    if (const double step_s = s.model->get()->opt.timestep; !(step_s >= 1e-6))
      throw InputError(fmt::format("{}: the model's timestep is {} s; a bus needs at least 1e-6", scenario, step_s));
    return s;
  }
  hil::Budget budget(const twin::Scenario& scenario, double bit_rate) const;
  std::uint32_t cycle_us() const { return static_cast<std::uint32_t>(std::lround(1e3 * cycle_ms)); }
};

/// The drives of a scenario as the bus sees them before a master changes anything.
class Drives {
 public:
  Drives(const twin::Scenario& scenario, const Common& c)
      : parameters_(hil::drive_parameters(scenario, c.first_node, c.cycle_us())) {
    for (const auto& p : parameters_) dictionaries_.push_back(hil::drive_dictionary(p));
    for (std::size_t i = 0; i < parameters_.size(); ++i) described_.push_back({&dictionaries_[i], &parameters_[i]});
  }
  std::span<const hil::DescribedDrive> all() const { return described_; }

 private:
  std::vector<hil::DriveParameters> parameters_;
  std::deque<hil::Dictionary> dictionaries_;
  std::vector<hil::DescribedDrive> described_;
};

hil::Budget Common::budget(const twin::Scenario& scenario, double bit_rate) const {
  if (mirror())
    return hil::budget_of_frames(static_cast<int>(scenario.model->drives().size()), 1e-3 * cycle_ms, bit_rate);
  return hil::budget(Drives(scenario, *this).all(), 1e-3 * cycle_ms, bit_rate);
}

void status_line(const hil::SessionStatus& s) {
  std::string drives;
  double hottest = -1e9;
  for (std::size_t i = 0; i < s.bench->drives().size(); ++i) {
    const auto& drive = *s.bench->drives()[i];
    drives += drive.enabled() ? 'E' : drive.failed() ? 'F' : drive.brake_engaged() ? '-' : '+';
    hottest = std::max(hottest, s.bench->plant().twin().temperature_degC(i));
  }
  tell(fmt::format(
      "\r\033[K{:.1f} s, {} syncs, bus {:.0f} %, drives {} (E enabled, F fault), hottest {:.1f} degC, lost {}, {}",
      s.simulated_s, s.bench->counters().syncs, 100 * s.bus_load, drives, hottest,
      s.bus->counters().receive_lost + s.bus->counters().send_busy + s.bus->counters().send_down, s.bus->state()));
}

/// --force of the commands that write.
void add_force(CLI::App& command, bool& force) { command.add_flag("--force", force, "Replace files that exist"); }

/// Whether a command may write these files, before its work.
void check_outputs(const std::vector<hil::NamedFile>& inputs, const std::vector<hil::NamedFile>& outputs, bool force) {
  hil::refuse_shared(inputs, outputs);
  if (!force) hil::refuse_recorded(outputs);
}

struct DriveArguments : Common {
  std::string can, record, stats, output, faults;
  std::optional<double> duration;
  bool realtime = false, lockstep = false, quiet = false, force = false;

  void add_to(CLI::App& command) {
    Common::add_to(command);
    add_profile(command);
    command.add_option("--can", can, "Bus: vcan0, can0, socketcand://127.0.0.1:29536/NAME")->required();
    auto* clock = command.add_flag("--realtime", realtime, "The robot moves with the clock");
    command.add_flag("--sync-lockstep", lockstep, "Every SYNC moves the robot on by one cycle (default)")
        ->excludes(clock);
    command.add_option("--duration", duration, "End after so much simulated time [s]")->check(CLI::PositiveNumber);
    command.add_option("--record", record, "Everything on the bus as a candump log");
    command.add_option("--stats", stats, "Counters of the session as JSON");
    command.add_option("--faults", faults, "Faults on purpose: a YAML list (hil/README.md)");
    command.add_option("-o,--output", output, "Folder for telemetry.h5, scenario.yaml, summary.json");
    add_force(command, force);
    command.add_flag("--quiet", quiet, "No status line");
    command.footer(
        "Example:\n  tribotwin-hil drive twin/scenarios/irb6620_hold.yaml --can socketcand://127.0.0.1:29536/can0 "
        "--duration 10");
  }
  void check_files(const twin::Scenario& scenario) const {
    auto inputs = hil::files_of(scenario);
    inputs.push_back({"--faults " + faults, faults});
    auto outputs = hil::files_in(output);
    outputs.push_back({"--record " + record, record});
    outputs.push_back({"--stats " + stats, stats});
    check_outputs(inputs, outputs, force);
    for (const auto& file : {record, stats})
      if (!file.empty()) twin::or_wrong_input(twin::check_output(file, twin::Existing::replace));
    if (!stats.empty()) twin::or_wrong_input(twin::check_output(stats, twin::replace_if(force)));
  }
};

int run_drives(const DriveArguments& a) {
  const twin::Scenario scenario = a.load();
  const int drives = static_cast<int>(scenario.model->drives().size());
  a.check_files(scenario);
  const hil::Budget budget = a.budget(scenario, 1e6);
  if (budget.most > 1)
    throw InputError(
        fmt::format("--cycle {}: {}; choose a longer cycle or fewer drives on one bus", a.cycle_ms, budget.line()));
  if (budget.most > 0.8) twin::note("{}", budget.line());
  std::vector<hil::Fault> faults;
  if (!a.faults.empty()) faults = hil::load_faults(a.faults, a.first_node, drives);
  twin::catch_interrupts();
  auto bus = hil::open_bus(a.can);
  if (!bus) throw InputError(bus.error().message);
  const bool live = !a.quiet && isatty(STDERR_FILENO);
  if (!a.quiet)
    tell(fmt::format("{} drives, nodes {} to {}, on {}; {}\n", drives, a.first_node, a.first_node + drives - 1,
                     (*bus)->name(),
                     a.realtime ? "the robot moves with the clock" : "every SYNC moves the robot on by one cycle"));
  const auto ended = hil::drive(
      scenario, **bus,
      {.profile = a.speaks(),
       .first_node = a.first_node,
       .cycle_us = a.cycle_us(),
       .realtime = a.realtime,
       .duration_s = a.duration,
       .record = a.record,
       .statistics = a.stats,
       .output = a.output,
       .existing = twin::replace_if(a.force),
       .faults = faults,
       .stop = stop,
       .status = live ? status_line : std::function<void(const hil::SessionStatus&)>{},
       .note = [&](const std::string& what) { tell(fmt::format("{}note: {}\n", live ? "\r\033[K" : "", what)); }});
  if (live) tell("\n");
  return ended ? done : report_error(program, failed, ended.error().message);
}

struct ReplayArguments : Common {
  std::string log, output;
  double rate = 1;
  bool fast = false, force = false;

  void add_to(CLI::App& command) {
    Common::add_to(command);
    add_profile(command);
    command.add_option("LOG", log, "candump log, as --record writes it")->required();
    auto* speed = command.add_option("--rate", rate, "Speed: 1 is the original")
                      ->check(CLI::PositiveNumber)
                      ->capture_default_str();
    command.add_flag("--fast", fast, "As fast as possible")->excludes(speed);
    command.add_option("-o,--output", output, "Folder for telemetry.h5, scenario.yaml, summary.json");
    add_force(command, force);
    command.footer("Example:\n  tribotwin-hil replay twin/scenarios/irb6620_hold.yaml session.log --fast");
  }
};

int replay(const ReplayArguments& a) {
  const twin::Scenario scenario = a.load();
  if (!fs::exists(a.log)) throw InputError(fmt::format("{}: does not exist", a.log));
  auto inputs = hil::files_of(scenario);
  inputs.push_back({"LOG " + a.log, a.log});
  check_outputs(inputs, hil::files_in(a.output), a.force);
  twin::catch_interrupts();
  const auto result = hil::replay(scenario, a.log,
                                  {.profile = a.speaks(),
                                   .first_node = a.first_node,
                                   .cycle_us = a.cycle_us(),
                                   .rate = a.fast ? 0 : a.rate,
                                   .output = a.output,
                                   .existing = twin::replace_if(a.force),
                                   .stop = stop});
  if (!result) return report_error(program, failed, result.error().message);
  twin::print("{} frames, {} from the drives: {} differ, {} missing, {} added\n", result->frames, result->compared,
              result->differing, result->missing, result->added);
  if (result->interrupted)
    return report_error(
        program, failed,
        fmt::format("interrupted after {} frames; {}", result->frames,
                    result->first_difference.empty() ? "no difference so far" : result->first_difference));
  if (result->frames == 0)
    return report_error(program, wrong_input, fmt::format("{}: holds no frame; nothing was compared", a.log));
  if (!result->silent.empty())
    return report_error(program, wrong_input,
                        fmt::format("{}: no frame from the drive of {}; nothing was compared there: is --first-node {} "
                                    "right, and --profile {}?",
                                    a.log, fmt::join(result->silent, ", "), a.first_node, a.profile));
  if (result->first_difference.empty()) return done;
  return report_error(program, failed, result->first_difference);
}

struct ShadowArguments : Common {
  std::string can, csv;
  std::optional<double> limit, duration;
  double limit_time = 0.5;
  std::vector<std::string> joints;
  bool force = false;

  void add_to(CLI::App& command) {
    Common::add_to(command);
    add_profile(command);
    command.add_option("--can", can, "Bus: vcan0, can0, or log:FILE for a candump log")->required();
    auto* limited =
        command.add_option("--limit", limit, "Largest residual torque, arm side [Nm]; beyond it: exit code 3")
            ->check(CLI::PositiveNumber);
    command.add_option("--limit-time", limit_time, "... for so long [s]")
        ->check(CLI::NonNegativeNumber)
        ->capture_default_str();
    command.add_option("--joint", joints, "A joint that --limit holds for, by name; again for more (default: all)")
        ->allow_extra_args(false)
        ->needs(limited);
    command.add_option("--duration", duration, "End after so much time on the bus [s]")->check(CLI::PositiveNumber);
    command.add_option("--csv", csv, "Measured, predicted, residual and temperature of every cycle");
    add_force(command, force);
    command.footer(
        "Example:\n  tribotwin-hil shadow twin/scenarios/irb6620_hold.yaml --can log:session.log --limit 200");
  }
  std::string log() const { return can.starts_with("log:") ? can.substr(4) : ""; }
};

/// Frames of a live bus, until a signal or the end of `duration_s` by the clock: a bus may fall silent.
hil::NextFrame frames_of(hil::Transport& bus, std::optional<double> duration_s) {
  return [&bus, duration_s, heard = false, begin_ns = hil::clock_ns()](hil::Frame& frame) mutable -> Result<bool> {
    while (!stop()) {
      const std::int64_t now_ns = hil::clock_ns();
      const bool received = bus.receive(frame);
      if (received && !std::exchange(heard, true)) begin_ns = now_ns;
      if (received) return true;
      if (duration_s && 1e-9 * static_cast<double>(now_ns - begin_ns) > *duration_s) return false;
      bus.wait(now_ns + 100'000'000);
    }
    return false;
  };
}

/// What a session of `shadow` says in the end, the gravest first.
int judge(const ShadowArguments& a, const hil::ShadowResult& result) {
  int code = done;
  const auto report = [&](twin::Exit grave, const std::string& what) {
    report_error(program, grave, what);
    if (code == done) code = grave;
  };
  if (result.exceeded()) code = twin::limit_exceeded;  // said when it happened
  if (!result.csv_failure.empty()) report(failed, result.csv_failure);
  if (result.interrupted)
    report(failed, fmt::format("interrupted at {:.3f} s{}", result.seconds,
                               a.duration ? fmt::format(" of {} s", *a.duration) : ", before the end of the log"));
  for (const auto& reason : result.unchecked)
    report(wrong_input, fmt::format("--limit {} was not checked: {}", *a.limit, reason));
  return code;
}

int run_shadow(const ShadowArguments& a) {
  const twin::Scenario scenario = a.load();
  auto inputs = hil::files_of(scenario);
  inputs.push_back({"--can " + a.can, a.log()});
  check_outputs(inputs, {{"--csv " + a.csv, a.csv}}, a.force);
  if (!a.csv.empty()) twin::or_wrong_input(twin::check_output(a.csv, twin::Existing::replace));
  twin::catch_interrupts();
  hil::NextFrame next;
  std::unique_ptr<hil::Transport> bus;
  std::optional<hil::LogReader> log;
  if (!a.log().empty()) {
    auto reader = hil::LogReader::open(a.log(), stop);
    if (!reader) throw InputError(reader.error().message);
    log.emplace(std::move(*reader));
    next = [&](hil::Frame& frame) { return log->next(frame); };
  } else {
    auto opened = hil::open_bus(a.can, {.listen_only = true});
    if (!opened) throw InputError(opened.error().message);
    bus = std::move(*opened);
    next = frames_of(*bus, a.duration);
  }
  const auto result = hil::shadow(scenario, next,
                                  {.profile = a.speaks(),
                                   .first_node = a.first_node,
                                   .cycle_us = a.cycle_us(),
                                   .limit_nm = a.limit,
                                   .limit_time_s = a.limit_time,
                                   .limit_joints = a.joints,
                                   .duration_s = a.duration,
                                   .csv = a.csv,
                                   .existing = twin::replace_if(a.force),
                                   .stop = stop,
                                   .endless = !log && !a.duration,
                                   .note = [&](const std::string& what) { tell(what + "\n"); }});
  if (!result) return report_error(program, failed, result.error().message);
  twin::print_text(result->table());
  return judge(a, *result);
}

struct BudgetArguments : Common {
  double bit_rate = 1e6;

  void add_to(CLI::App& command) {
    Common::add_to(command);
    add_profile(command);
    command.add_option("--bit-rate", bit_rate, "[bit/s]")->check(CLI::Range(1e4, 1e6))->capture_default_str();
    command.footer("Example:\n  tribotwin-hil budget twin/scenarios/irb6620_hold.yaml --cycle 2");
  }
};

int run_budget(const BudgetArguments& a) {
  const twin::Scenario scenario = a.load();
  const hil::Budget budget = a.budget(scenario, a.bit_rate);
  twin::print("{}\n", budget.line());
  if (budget.most > 1)
    return report_error(program, wrong_input,
                        "more than the bus can carry; choose a longer cycle or fewer drives on one bus");
  if (budget.most > 0.8) twin::note("more than 80 % at worst; other traffic will not fit");
  return done;
}

/// eds and dbc: what the drives say about themselves.
struct DescriptionArguments : Common {
  twin::Destination destination;
  int node = 0;

  int write(const twin::Scenario& scenario, std::string_view text) const {
    hil::refuse_shared(hil::files_of(scenario), {{"-o " + destination.file, destination.file}});
    twin::or_wrong_input(destination.check({}));
    return destination.deliver(program, text);
  }
};

int write_eds(const DescriptionArguments& a) {
  const twin::Scenario scenario = a.load();
  const Drives drives(scenario, a);
  for (const auto& described : drives.all())
    if (a.node == 0 || described.parameters->node == a.node)
      return a.write(scenario, hil::eds(*described.dictionary, *described.parameters));
  throw InputError(fmt::format("--node {}: the drives are nodes {} to {}", a.node, a.first_node,
                               a.first_node + static_cast<int>(drives.all().size()) - 1));
}

int write_dbc(const DescriptionArguments& a) {
  const twin::Scenario scenario = a.load();
  const Drives drives(scenario, a);
  if (!a.mirror()) return a.write(scenario, hil::dbc(drives.all()));
  std::vector<hil::DescribedMirror> all;
  for (const auto& d : drives.all())
    all.push_back({d.parameters->node, d.parameters->name, d.parameters->rated_torque_nm * d.parameters->gear_ratio});
  return a.write(scenario, hil::mirror_dbc(all));
}

void add_descriptions(CLI::App& app, DescriptionArguments& a, int& code) {
  auto* eds = app.add_subcommand("eds", "The electronic data sheet of a drive");
  a.add_to(*eds);
  eds->add_option("--node", a.node, "Of this node (default: the first)");
  a.destination.add_to(*eds, "File to write (default: stdout)");
  eds->footer("Example:\n  tribotwin-hil eds twin/scenarios/irb6620_hold.yaml -o drive.eds");
  eds->callback([&] { code = write_eds(a); });
  auto* dbc = app.add_subcommand("dbc", "All cyclic frames of all drives as a DBC");
  a.add_to(*dbc);
  a.add_profile(*dbc);
  a.destination.add_to(*dbc, "File to write (default: stdout)");
  dbc->footer("Example:\n  tribotwin-hil dbc twin/scenarios/irb6620_hold.yaml -o drives.dbc");
  dbc->callback([&] { code = write_dbc(a); });
}

/// One command, its arguments and what it does with them.
template <class Arguments>
void add_command(CLI::App& app, const char* name, const char* description, Arguments& arguments,
                 int (*run)(const Arguments&), int& code) {
  auto* command = app.add_subcommand(name, description);
  arguments.add_to(*command);
  command->callback([&arguments, run, &code] { code = run(arguments); });
}

}  // namespace

int main(int argc, char** argv) {
  twin::prepare_streams();
  mujoco::install_message_handlers();

  CLI::App app{"tribotwin-hil: the joints of a robot as drives on a CAN bus"};
  app.require_subcommand(1);
  app.set_version_flag("--version", std::string("tribotwin-hil " TRIBOTWIN_VERSION ", MuJoCo ") + mj_versionString());
  int code = done;
  DriveArguments drive;
  ReplayArguments replayed;
  ShadowArguments shadow;
  BudgetArguments budget;
  DescriptionArguments description;
  add_command(app, "drive", "Be the drives of a robot, one per joint", drive, run_drives, code);
  add_command(app, "replay", "A recorded session through the same drives, compared with what they said then", replayed,
              replay, code);
  add_command(app, "shadow", "Listen beside a robot: what torque and temperature it should have", shadow, run_shadow,
              code);
  add_command(app, "budget", "The load of the bus, before anything runs", budget, run_budget, code);
  add_descriptions(app, description, code);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    std::ostringstream out, why;
    code = app.exit(error, out, why) == 0 ? done : wrong_input;
    twin::print_text(out.str());
    twin::report_text(why.str());
  } catch (const InputError& error) {
    code = report_error(program, wrong_input, error.what());
  } catch (const std::exception& error) {
    code = report_error(program, failed, error.what());
  }
  return twin::finish(program, code);
}
