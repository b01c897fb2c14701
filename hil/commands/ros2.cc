#include <algorithm>
#include <deque>
#include <filesystem>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/eds.hpp>
#include <tribotwin/hil/commands/program.hpp>
#include <tribotwin/hil/ros2/bus.hpp>
#include <tribotwin/hil/ros2/readme.hpp>

namespace tribotwin::hil::program {
namespace {

namespace fs = std::filesystem;
using twin::InputError;

struct Arguments : RobotOptions {
  std::string folder;
  double bit_rate = 1e6;
  bool force = false, json = false;

  /// 10 ms, as in the samples of ros2_canopen: its drivers run on timers of whole milliseconds.
  Arguments() { cycle_ms = 10; }

  void add_to(CLI::App& command) {
    RobotOptions::add_to(command);
    command.add_option("-o,--output", folder, "Folder for bus.yml, an EDS per drive and README.md")->required();
    command.add_option("--bitrate,--bit-rate", bit_rate, "Of the bus [bit/s], for its load")
        ->check(CLI::Range(1e4, 1e6))
        ->capture_default_str();
    add_force(command, force);
    command.add_flag("--json", json, "Print the names of the files written as JSON");
    command.footer("Example:\n  tribotwin-hil ros2 twin/scenarios/irb6620_hold.yaml -o irb6620_bus");
  }

  /// Of `drive`, for the README.
  std::vector<std::string> drive_arguments() const {
    std::vector<std::string> words{scenario};
    for (const auto& setting : settings) words.insert(words.end(), {"--set", setting});
    words.insert(words.end(), {"--can", "vcan0", "--realtime", "--cycle", fmt::format("{:.6g}", cycle_ms)});
    if (first_node != 1) words.insert(words.end(), {"--first-node", fmt::to_string(first_node)});
    return words;
  }
};

/// The drives as the configuration leaves them.
class MappedDrives {
 public:
  explicit MappedDrives(std::span<const DescribedDrive> drives) {
    for (const auto& d : drives) {
      map_for_ros2(dictionaries_.emplace_back(*d.dictionary));
      described_.push_back({&dictionaries_.back(), d.parameters});
    }
  }
  std::span<const DescribedDrive> all() const { return described_; }

 private:
  std::deque<Dictionary> dictionaries_;
  std::vector<DescribedDrive> described_;
};

std::vector<twin::OutputFile> files(const Arguments& a, const Drives& drives) {
  const MappedDrives mapped(drives.all());
  if (ros2_master_node(mapped.all()) == 0)
    throw InputError(
        fmt::format("{}: {} drives leave no node number for the master; at most 126", a.scenario, drives.all().size()));
  const Budget load = hil::budget(mapped.all(), 1e-3 * a.cycle_ms, a.bit_rate);
  if (load.max > 0.8) twin::note("{}", load.line());
  const std::string folder = twin::name_of_folder(a.folder);
  std::vector<twin::OutputFile> all{
      {"bus.yml", ros2_bus(mapped.all(), a.cycle_us())},
      {"README.md",
       ros2_readme(mapped.all(), {.folder = folder,
                                  .arguments = a.drive_arguments(),
                                  .bus_load = fmt::format("At {:g} kbit/s: {}.", 1e-3 * a.bit_rate, load.line()),
                                  .cycle_us = a.cycle_us()})}};
  for (const auto& d : drives.all())
    all.push_back({fmt::format("node{}.eds", d.parameters->node), hil::eds(*d.dictionary, *d.parameters)});
  return all;
}

/// The timers of ros2_canopen's drivers count whole milliseconds.
void note_rounding(const Arguments& a) {
  const std::uint32_t cycle_us = a.cycle_us();
  if (cycle_us % 1000 == 0) return;
  twin::note(
      "--cycle {}: SYNC and drives have {} us, but the loop of ros2_canopen's drivers takes whole milliseconds: "
      "period {} in bus.yml; with a whole --cycle both are the same",
      a.cycle_ms, cycle_us, std::max(1U, cycle_us / 1000));
}

int run(const Arguments& a) {
  const twin::Scenario scenario = a.load();
  twin::or_wrong_input(twin::check_output_folder(a.folder, twin::replace_if(a.force)));
  const auto all = files(a, Drives(scenario, a));
  std::vector<NamedFile> outputs;
  for (const auto& file : all) outputs.push_back({"-o " + a.folder, fs::path(a.folder) / file.name});
  twin::or_wrong_input(refuse_shared(files_of(scenario), outputs));
  twin::or_throw(twin::write_folder(a.folder, all, twin::replace_if(a.force)));
  note_rounding(a);
  if (a.json) {
    std::vector<std::string> names;
    for (const auto& file : outputs) names.push_back(file.path.string());
    twin::print_text(twin::files_json(names));
  }
  return twin::done;
}

}  // namespace

void add_ros2(CLI::App& app, int& code) {
  declare(app, code, "ros2", "Configuration of ros2_canopen for the drives: a folder with bus.yml and EDS files", run);
}

}  // namespace tribotwin::hil::program
