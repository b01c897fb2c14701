#include <fmt/format.h>

#include <tribotwin/hil/commands/program.hpp>
#include <tribotwin/hil/conform/report.hpp>
#include <tribotwin/twin/io/interrupt.hpp>

namespace tribotwin::hil::program {
namespace {

constexpr char footer[] =
    "The node is reset (NMT), and its communication parameters and option codes are changed and restored. With\n"
    "--motion the drive is enabled and moved by a master of its own: at most 30 degrees of the motor (608Fh), 30 rpm\n"
    "(60A9h) for some seconds to either side, and 20 per mille of the rated torque beyond what holds the load, in\n"
    "torque mode without gravity compensation. Whatever happens, also on Ctrl-C, the drive is without power at the\n"
    "end. No other master may be on the bus.\n"
    "\n"
    "Exit codes: 0 all checks passed or not applicable, 1 no node answered or the run was interrupted, 2 wrong usage,\n"
    "3 a check failed.\n"
    "\n"
    "Example:\n  tribotwin-hil conform --can vcan0 --node 1 --eds drive.eds --motion -o report.txt";

struct Arguments {
  std::string can, eds;
  int node = 1;
  bool json = false, quiet = false;
  ConformOptions options;
  double boot_s = 5;
  twin::Destination destination;

  void add_to(CLI::App& command) {
    command.add_option("--can", can, "Bus: vcan0, can0, gateway://HOST:29536/NAME, socketcand://127.0.0.1:29536/NAME")
        ->required();
    command.add_option("--node", node, "Node number of the device")->check(CLI::Range(1, 127))->capture_default_str();
    command.add_option("--eds", eds, "Electronic data sheet of the device; it is compared with the device");
    auto* motion = command.add_flag("--motion", options.motion, "Also checks that enable the drive and move it");
    command.add_flag("--homing", options.homing, "Also homing at the present position: a new reference position")
        ->needs(motion);
    command.add_option("--amplitude", options.amplitude, "Of motion [counts of 6064h] (default: 30 degrees by 608Fh)")
        ->check(CLI::Range(1, 1 << 30));
    command.add_option("--speed", options.speed, "Of motion [counts of 606Ch] (default: 30 rpm by 60A9h)")
        ->check(CLI::Range(1, 1 << 30));
    command.add_option("--torque", options.torque, "Of motion [per mille of 6076h] (default: 20)")
        ->check(CLI::Range(1, 1000));
    command.add_option("--only", options.only, "Only these checks or groups of them, as sdo.block_upload,state")
        ->delimiter(',');
    command.add_option("--boot-time", boot_s, "Longest time from a reset to the boot-up message [s]")
        ->check(CLI::Range(0.1, 120.0))
        ->capture_default_str();
    command.add_flag("--json", json, "The report as JSON");
    command.add_flag("--quiet", quiet, "No progress");
    destination.add_to(command, "File for the report (default: stdout)");
    command.footer(footer);
  }
};

int run(const Arguments& a) {
  std::vector<std::filesystem::path> inputs;
  if (!a.eds.empty()) inputs.emplace_back(a.eds);
  twin::or_wrong_input(a.destination.check(inputs));
  twin::or_wrong_input(checks_named(a.options.only));
  const auto node = static_cast<std::uint8_t>(a.node);
  std::optional<Eds> eds;
  if (!a.eds.empty()) eds = twin::or_wrong_input(load_eds(a.eds, node));
  ConformOptions options = a.options;
  options.eds = eds ? &*eds : nullptr;
  options.boot_ns = static_cast<std::int64_t>(1e9 * a.boot_s);

  twin::catch_interrupts();
  const auto bus = twin::or_wrong_input(open_bus(a.can));
  twin::Progress progress(a.quiet, "checks");
  const auto report =
      twin::or_throw(conform(*bus, node, options, {.stop = stop}, [&](std::size_t i, std::size_t count, const Check&) {
        progress(double(i) / double(count));
      }));
  twin::or_throw(a.destination.deliver(a.json ? to_json(report) : to_text(report)));
  if (report.interrupted) {
    const char* power = report.without_power ? "the drive is without power" : "THE DRIVE MAY STILL HAVE POWER";
    return report_error(twin::failed, fmt::format("interrupted; {}", power));
  }
  if (const int failed = report.count(Verdict::fail); failed > 0)
    return report_error(twin::limit_exceeded, fmt::format("{} of {} checks failed", failed, report.findings.size()));
  return twin::done;
}

}  // namespace

void add_conform(CLI::App& app, int& code) {
  declare(app, code, "conform", "Check a drive on a bus against CiA 301 and CiA 402-2, ours or a real one", run);
}

}  // namespace tribotwin::hil::program
