#include <algorithm>
#include <string_view>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/hil/commands/can_options.hpp>
#include <tribotwin/hil/session/session_file.hpp>

namespace tribotwin::hil::program {
namespace {

using twin::InputError;

constexpr std::size_t most_buses = 2;

/// BUS and JOINT,... of --can BUS=JOINT,...; the last '=' counts.
std::pair<std::string, std::optional<std::string>> parts_of(const std::string& given) {
  const auto mark = given.rfind('=');
  if (mark == given.npos) return {given, std::nullopt};
  return {given.substr(0, mark), given.substr(mark + 1)};
}

std::vector<std::string> split(std::string_view list) {
  std::vector<std::string> names;
  for (;;) {
    const auto comma = list.find(',');
    names.emplace_back(list.substr(0, comma));
    if (comma == list.npos) return names;
    list.remove_prefix(comma + 1);
  }
}

/// The two spellings of a SocketCAN interface are one bus.
std::string_view interface_of(std::string_view bus) {
  constexpr std::string_view prefix = "socketcan:";
  return bus.starts_with(prefix) ? bus.substr(prefix.size()) : bus;
}

std::vector<std::string> joints_of(const twin::Scenario& robot) {
  std::vector<std::string> names;
  for (const auto& drive : robot.model->drives()) names.push_back(twin::joint_name(robot.model->get(), drive));
  return names;
}

/// As an example: the robot's joints on two buses.
std::string example(const std::vector<std::string>& buses, const std::vector<std::string>& joints) {
  const auto half = joints.begin() + static_cast<std::ptrdiff_t>((joints.size() + 1) / 2);
  return fmt::format("--can {}={} --can {}={}", buses[0], fmt::join(joints.begin(), half, ","), buses[1],
                     fmt::join(half, joints.end(), ","));
}

}  // namespace

CLI::Option* CanOptions::add_to(CLI::App& command, const std::string& what) {
  return command
      .add_option("--can", given,
                  what +
                      "; for a robot on two buses once per bus: BUS=JOINT,..., which get the nodes --first-node and "
                      "up on that bus")
      ->allow_extra_args(false);
}

std::vector<std::string> CanOptions::buses() const {
  if (given.size() > most_buses)
    throw InputError(fmt::format("--can: {} buses; a robot is on one or two", given.size()));
  std::vector<std::string> buses;
  for (const std::string& one : given) {
    const auto& bus = buses.emplace_back(parts_of(one).first);
    if (bus.empty()) throw InputError(fmt::format("--can {}: names no bus; give BUS=JOINT,...", one));
    if (buses.size() > 1 && interface_of(bus) == interface_of(buses[0]))
      throw InputError(fmt::format("--can {}: both are the bus {}; give two", one, buses[0]));
  }
  return buses;
}

Wiring CanOptions::wiring(const twin::Scenario& robot) const {
  const auto names = buses();
  const auto joints = joints_of(robot);
  Wiring wiring;
  std::vector<std::string> on(joints.size());  // which --can has the joint
  for (const std::string& one : given) {
    const auto list = parts_of(one).second;
    if (!list && given.size() == 1) return {};
    if (!list)
      throw InputError(fmt::format("--can {}: which joints are on it? For example {}", one, example(names, joints)));
    auto& drives = wiring.emplace_back();
    for (const std::string& joint : split(*list)) {
      const auto found = std::ranges::find(joints, joint);
      if (found == joints.end())
        throw InputError(fmt::format("--can {}: no joint '{}'; there are {}", one, joint, fmt::join(joints, ", ")));
      const auto drive = static_cast<std::size_t>(found - joints.begin());
      if (!on[drive].empty())
        throw InputError(
            fmt::format("--can {}: {} is in --can {} already; a joint is on one bus", one, joint, on[drive]));
      on[drive] = one;
      drives.push_back(drive);
    }
  }
  for (std::size_t i = 0; i < joints.size(); ++i)
    if (!wiring.empty() && on[i].empty())
      throw InputError(fmt::format("--can: {} is on no bus; each joint is on one", joints[i]));
  const bool usual = wiring.size() == 1 && std::ranges::is_sorted(wiring[0]);
  return usual ? Wiring{} : wiring;
}

Wiring wiring_of_log(const twin::Scenario& robot, const std::filesystem::path& log) {
  const Wiring wiring = twin::or_wrong_input(recorded_wiring(log));
  if (!wires_all(wiring, robot.model->drives().size()))
    throw InputError(fmt::format("{}: its buses do not have each of the {} drives of this scenario once",
                                 session_file_of(log).string(), robot.model->drives().size()));
  return wiring;
}

std::string nodes_on(const Wiring& wiring, std::size_t drives, int first_node, const std::vector<std::string>& buses) {
  std::vector<std::string> all;
  for (std::size_t bus = 0; bus < bus_count(wiring); ++bus) {
    const std::size_t count = wiring.empty() ? drives : wiring[bus].size();
    all.push_back(fmt::format("{}, on {}", node_range(first_node, count), buses[bus]));
  }
  return fmt::format("{}", fmt::join(all, ", "));
}

}  // namespace tribotwin::hil::program
