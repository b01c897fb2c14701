#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include <fmt/format.h>

#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/portable/robot/robot_instance.h>
#include <tribotwin/twin/portable/robot/robot_variables.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/robot/fingerprint.hpp>

namespace tw = tribotwin::twin;

struct tribotwin_robot {
  std::optional<tw::Scenario> scenario;
  tw::RobotCommands commands;
  std::vector<tw::FmuVariable> variables;
  std::vector<tribotwin_robot_variable> described;  ///< of all variables but the Boolean
  std::vector<double> values;                       ///< of those
  std::unique_ptr<tw::Twin> twin;
  bool outside = false;
  double mark = 0;  ///< of this FMU, by its token: a part of saved states

  std::size_t drives() const { return twin->model().drives().size(); }
  /// Reads the outputs. Without a step there is no friction yet: it is 0.
  void read() {
    const auto outputs = tw::robot_outputs();
    std::size_t at = 1 + (commands == tw::RobotCommands::scenario ? 0 : drives());
    outside = false;
    for (std::size_t i = 0; i < drives(); ++i) {
      for (const tw::RobotOutput& output : outputs)
        if (output.in(twin->model().drives()[i].drive)) values[at++] = output.value(*twin, i);
      outside = outside || twin->drive(i).outside != 0;
    }
  }
  void start() {
    twin = commands == tw::RobotCommands::scenario ? std::make_unique<tw::Twin>(*scenario)
                                                   : std::make_unique<tw::Twin>(*scenario, tw::Twin::commanded);
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = variables[i].start;
    read();
  }
};

namespace {

namespace fs = std::filesystem;

void say(const std::string& what, char* text, size_t size) { std::snprintf(text, size, "%s", what.c_str()); }

/// The folder that an importer names, as path or as URI (RFC 8089; RFC 3986: %20).
fs::path folder_of(std::string given) {
  if (given.starts_with("file:")) {
    given.erase(0, 5);
    if (given.starts_with("//")) given.erase(0, std::min(given.find('/', 2), given.size()));
    std::string decoded;
    for (std::size_t i = 0; i < given.size(); ++i) {
      unsigned byte = 0;
      if (given[i] == '%' && std::sscanf(given.c_str() + i, "%%%2x", &byte) == 1)
        decoded += static_cast<char>(byte), i += 2;
      else
        decoded += given[i];
    }
    given = decoded;
  }
  return given;
}

/// Of the token, exact as a double.
double mark_of(std::string_view token) {
  tw::Fingerprint mark;
  mark.add(token);
  return static_cast<double>(mark.value() >> 12);
}

std::unique_ptr<tribotwin_robot> open_robot(const char* token, const char* resources) {
  if (!resources || !*resources)
    throw tw::InputError("the importer names no folder of resources, which hold the robot");
  const fs::path folder = folder_of(resources);
  if (!mju_user_error && !mju_user_warning) tribotwin::mujoco::install_message_handlers();
  tw::Mapping about((folder / "fmu.yaml").string(), "", tw::load_yaml(folder / "fmu.yaml"));
  if (!token || about.text("token") != token)
    throw tw::InputError("the GUID or token is not that of this FMU's modelDescription.xml");
  const std::string engine = about.text("mujoco");
  if (engine != mj_versionString())
    throw tw::InputError(
        fmt::format("it was made for MuJoCo {} but MuJoCo {} is installed here", engine, mj_versionString()));
  auto robot = std::make_unique<tribotwin_robot>();
  robot->mark = mark_of(token);
  const auto commands = tw::robot_commands(about.text("commands"));
  if (!commands) about.fail("commands", "is none that this library knows");
  robot->commands = *commands;
  robot->scenario = tw::or_throw(tw::load_scenario(folder / "scenario.yaml"));
  robot->variables = tw::robot_variables(*robot->scenario, robot->commands);
  for (const tw::FmuVariable& v : robot->variables)
    if (!v.unit.empty())
      robot->described.push_back({v.name.c_str(), v.kind == tw::FmuKind::input, v.minimum, v.maximum});
  robot->values.resize(robot->described.size());
  robot->start();
  return robot;
}

/// Whole time steps in dt.
std::int64_t steps_in(const tw::Twin& twin, double dt_s) {
  const double one_s = twin.model()->opt.timestep, count = std::round(dt_s / one_s);
  if (!(count >= 1 && std::abs(count * one_s - dt_s) <= 1e-9 * (one_s + dt_s)))
    throw tw::InputError(
        fmt::format("the step is {} s but must be a multiple of the robot's time step, {} s", dt_s, one_s));
  if (static_cast<double>(twin.steps_total() - twin.steps()) < count)
    throw tw::InputError(fmt::format("the scenario ends at {} s", twin.scenario().duration_s));
  return static_cast<std::int64_t>(count);
}

/// A command that is no number would end the simulation.
void take_commands(tribotwin_robot& robot) {
  if (robot.commands == tw::RobotCommands::scenario) return;
  for (std::size_t i = 0; i < robot.drives(); ++i) {
    const double value = robot.values[1 + i];
    if (!std::isfinite(value)) throw tw::InputError(fmt::format("{} is not finite", robot.variables[1 + i].name));
    robot.twin->commands()[i] = tw::robot_command(robot.commands, value);
  }
}

/// No exception crosses into the importer.
template <class Work>
auto guarded(char* text, size_t size, Work work) -> decltype(work()) {
  try {
    return work();
  } catch (const std::exception& e) {
    say(e.what(), text, size);
    return {};
  }
}

}  // namespace

extern "C" {

tribotwin_robot* tribotwin_robot_open(const char* token, const char* resources, char* text, size_t size) {
  return guarded(text, size, [&] { return open_robot(token, resources); }).release();
}

void tribotwin_robot_close(tribotwin_robot* robot) { delete robot; }

int tribotwin_robot_reset(tribotwin_robot* robot, char* text, size_t size) {
  return guarded(text, size, [&] { return robot->start(), 1; });
}

int tribotwin_robot_step(tribotwin_robot* robot, double dt_s, char* text, size_t size) {
  return guarded(text, size, [&] {
    const std::int64_t n = steps_in(*robot->twin, dt_s);
    take_commands(*robot);
    for (std::int64_t k = 0; k < n; ++k) tw::or_throw(robot->twin->step());
    return robot->read(), 1;
  });
}

size_t tribotwin_robot_save(tribotwin_robot* robot, double* numbers, char* text, size_t size) {
  return guarded(text, size, [&]() -> size_t {
    std::vector<double> all = tw::or_throw(robot->twin->save());
    all.insert(all.end(), robot->values.begin(), robot->values.end());
    all.insert(all.end(), {robot->outside ? 1.0 : 0.0, robot->mark});
    if (numbers) std::ranges::copy(all, numbers);
    return all.size();
  });
}

int tribotwin_robot_restore(tribotwin_robot* robot, const double* numbers, size_t count, char* text, size_t size) {
  return guarded(text, size, [&] {
    const std::span all(numbers, count);
    if (count == 0 || all.back() != robot->mark) throw tw::InputError("the state is one of another FMU");
    const size_t values = robot->values.size() + 2, of_twin = count - std::min(count, values);
    tw::or_throw(robot->twin->restore(all.first(of_twin)));
    std::ranges::copy(all.subspan(of_twin, robot->values.size()), robot->values.begin());
    robot->outside = all[count - 2] != 0;
    return 1;
  });
}

const tribotwin_robot_variable* tribotwin_robot_find(const tribotwin_robot* robot, unsigned reference) {
  return reference > 0 && reference < robot->described.size() ? &robot->described[reference] : nullptr;
}

double* tribotwin_robot_place(tribotwin_robot* robot, unsigned reference) { return &robot->values[reference]; }

unsigned tribotwin_robot_boolean(const tribotwin_robot* robot) {
  return static_cast<unsigned>(robot->described.size());
}

int tribotwin_robot_outside(const tribotwin_robot* robot) { return robot->outside; }

}  // extern "C"
