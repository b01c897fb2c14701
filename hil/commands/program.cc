#include <cmath>

#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <tribotwin/hil/cia402/drive_objects.hpp>
#include <tribotwin/hil/commands/program.hpp>
#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/io/shipped.hpp>

namespace tribotwin::hil::program {

using twin::InputError;

void report_nonblocking(const std::string& text) {
  pollfd reader{STDERR_FILENO, POLLOUT, 0};
  if (::poll(&reader, 1, 0) > 0) twin::report_text(text);
}

bool stop() { return twin::interrupted(); }

namespace {

/// A session lasts as long as its master or --duration: a scenario needs no duration_s. Nothing is read from a pipe,
/// which can be read once.
std::vector<std::string> with_duration(const std::filesystem::path& scenario, std::vector<std::string> settings) {
  std::error_code none;
  if (std::filesystem::is_regular_file(scenario, none) && !twin::load_yaml(scenario)["duration_s"])
    settings.insert(settings.begin(), "duration_s=1");
  return settings;
}

}  // namespace

void RobotOptions::add_to(CLI::App& command) {
  command
      .add_option(
          "SCENARIO", scenario,
          "Scenario file, or the name of a shipped one: model, start, surroundings and events; the master commands "
          "the motion")
      ->required();
  command.add_option("--set", settings, "key=value, dotted keys; replaces the value in the file")
      ->allow_extra_args(false);
  command.add_option("--first-node", first_node, "Node number of the first drive; the others count up")
      ->check(CLI::Range(1, 127))
      ->capture_default_str();
  cycle_option = command.add_option("--cycle", cycle_ms, "SYNC period [ms] (1006h)")
                     ->check(CLI::Range(0.1, 1000.0))
                     ->capture_default_str();
}

void RobotOptions::add_profile(CLI::App& command) {
  command
      .add_option("--profile", profile,
                  "Protocol: CANopen with CiA 402, or two plain frames per drive, classic or FD (see dbc)")
      ->check(CLI::IsMember({"cia402", "mirror", "mirror-fd"}))
      ->capture_default_str();
}

twin::Scenario RobotOptions::load() const {
  const auto file = twin::given_or_shipped(scenario, ".yaml");
  twin::Scenario s = twin::or_wrong_input(twin::load_scenario(file, with_duration(file, settings)));
  const std::size_t drives = s.model->drives().size();
  if (const std::size_t last = first_node + drives - 1; last > 127)
    throw InputError(
        fmt::format("--first-node {}: {} drives need node numbers up to {}; at most 127", first_node, drives, last));
  if (const double step_s = s.model->get()->opt.timestep; !(step_s >= 1e-6))
    throw InputError(fmt::format("{}: the model's timestep is {} s; a bus needs at least 1e-6", scenario, step_s));
  return s;
}

std::uint32_t RobotOptions::cycle_us() const { return static_cast<std::uint32_t>(std::lround(1e3 * cycle_ms)); }

Budget RobotOptions::budget(const twin::Scenario& robot, double bit_rate, const Wiring& wiring, std::size_t bus) const {
  if (mirror()) {
    const MirrorFormat format = mirror_format(bench_profile());
    const Bits each_way[] = {bits_of(encode(MirrorCommand{}, 1, format)), bits_of(encode(MirrorStatus{}, 1, format))};
    const std::size_t drives = wiring.empty() ? robot.model->drives().size() : wiring[bus].size();
    return budget_of_frames(static_cast<int>(drives), each_way, 1e-3 * cycle_ms, bit_rate);
  }
  const Drives drives(robot, *this, wiring);
  std::vector<DescribedDrive> on_bus;
  for (std::size_t i = 0; i < drives.all().size(); ++i)
    if (place_of(wiring, i).bus == bus) on_bus.push_back(drives.all()[i]);
  return hil::budget(on_bus, 1e-3 * cycle_ms, bit_rate);
}

std::string node_range(int first, std::size_t count) {
  if (count == 1) return fmt::format("node {}", first);
  return fmt::format("nodes {} to {}", first, static_cast<std::size_t>(first) + count - 1);
}

void add_force(CLI::App& command, bool& force) { command.add_flag("--force", force, "Replace files that exist"); }

void check_outputs(const std::vector<NamedFile>& inputs, const std::vector<NamedFile>& outputs, bool force) {
  twin::or_wrong_input(refuse_shared(inputs, outputs));
  if (!force) twin::or_wrong_input(refuse_recorded(outputs));
}

Drives::Drives(const twin::Scenario& scenario, const RobotOptions& options, const Wiring& wiring)
    : parameters_(drive_parameters(scenario, options.first_node, options.cycle_us(), wiring)) {
  for (const auto& p : parameters_) dictionaries_.push_back(drive_dictionary(p));
  for (std::size_t i = 0; i < parameters_.size(); ++i) described_.push_back({&dictionaries_[i], &parameters_[i]});
}

int deliver(const twin::Scenario& scenario, const twin::Destination& destination, std::string_view text) {
  twin::or_wrong_input(refuse_shared(files_of(scenario), {{"-o " + destination.file, destination.file}}));
  twin::or_wrong_input(destination.check({}));
  twin::or_throw(destination.deliver(text));
  return twin::done;
}

}  // namespace tribotwin::hil::program
