#include <algorithm>

#include <nlohmann/json.hpp>

#include <tribotwin/hil/commands/can_options.hpp>
#include <tribotwin/twin/io/json.hpp>

namespace tribotwin::hil::program {
namespace {

struct Arguments : RobotOptions {
  CanOptions can;
  double bit_rate = 1e6;
  twin::Destination destination;
  bool json = false;

  void add_to(CLI::App& command) {
    RobotOptions::add_to(command);
    add_profile(command);
    can.add_to(command, "BUS is any name here");
    command.add_option("--bitrate,--bit-rate", bit_rate, "Of the bus [bit/s]")
        ->check(CLI::Range(1e4, 1e6))
        ->capture_default_str();
    destination.add_to(command, "File to write (default: stdout)");
    command.add_flag("--json", json, "Print JSON instead of text");
    command.footer("Example:\n  tribotwin-hil budget twin/scenarios/irb6620_hold.yaml --cycle 2");
  }
};

nlohmann::ordered_json json_of(const Budget& load, const std::string& bus) {
  return {{"bus", bus},      {"cycle_s", load.cycle_s}, {"frames", load.frames},
          {"min", load.min}, {"max", load.max},         {"shortest_cycle_s", load.shortest_cycle_s}};
}

int run(const Arguments& a) {
  const twin::Scenario scenario = a.load();
  const Wiring wiring = a.can.wiring(scenario);
  const auto names = a.can.buses();
  double most = 0;
  std::string text;
  nlohmann::ordered_json json{{"buses", nlohmann::ordered_json::array()}};
  for (std::size_t bus = 0; bus < bus_count(wiring); ++bus) {
    const Budget load = a.budget(scenario, a.bit_rate, wiring, bus);
    text += (wiring.size() > 1 ? names[bus] + ": " : "") + load.line() + "\n";
    json["buses"].push_back(json_of(load, bus < names.size() ? names[bus] : ""));
    most = std::max(most, load.max);
  }
  deliver(scenario, a.destination, a.json ? twin::dump_json(json, 2) + "\n" : text);
  if (most > 1)
    return report_error(twin::wrong_input,
                        "more than the bus can carry; choose a longer cycle or fewer drives on one bus");
  if (most > 0.8) twin::note("more than 80 % at worst; other traffic will not fit");
  return twin::done;
}

}  // namespace

void add_budget(CLI::App& app, int& code) {
  declare(app, code, "budget", "The bus load of a scenario, without running it", run);
}

}  // namespace tribotwin::hil::program
