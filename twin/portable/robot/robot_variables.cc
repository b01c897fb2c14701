#include <algorithm>
#include <array>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/portable/robot/robot_variables.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::twin {
namespace {

constexpr std::array<std::pair<std::string_view, RobotCommands>, 4> commands_table{
    {{"scenario", RobotCommands::scenario},
     {"torque", RobotCommands::torque},
     {"velocity", RobotCommands::velocity},
     {"position", RobotCommands::position}}};

constexpr RobotOutput outputs[] = {
    {"position_rad", "rad", "angle",
     [](const Twin& t, std::size_t i) {
       return t.data()->qpos[position_address(t.model().get(), t.model().drives()[i])];
     }},
    {"velocity_rad_s", "rad/s", "speed",
     [](const Twin& t, std::size_t i) { return t.data()->qvel[t.model().drives()[i].dof]; }},
    {"torque_nm", "Nm", "motor torque by its current in the last time step, arm side",
     [](const Twin& t, std::size_t i) { return t.drive(i).torque_nm; }},
    {"friction_nm", "Nm", "friction in the last time step, positive against positive motion, arm side",
     [](const Twin& t, std::size_t i) { return t.drive(i).friction_nm; }},
    {"load_nm", "Nm", "gear torque at which friction of the last time step was evaluated, arm side",
     [](const Twin& t, std::size_t i) { return t.drive(i).load_used_nm; }},
    {"temperature_degC", "degC", "temperature of the lubricant",
     [](const Twin& t, std::size_t i) { return t.temperature_degC(i); }},
    {"heat_J", "J", "heat of the gear since the start, that from its motor's winding included",
     [](const Twin& t, std::size_t i) { return t.drive(i).heat_J; }},
    {"winding_temperature_degC", "degC", "temperature of the winding",
     [](const Twin& t, std::size_t i) { return t.winding_degC(i); }, true},
    {"motor_current_A", "A", "motor current in the last time step",
     [](const Twin& t, std::size_t i) { return t.drive(i).current_A; }, true},
    {"motor_current_limit_A", "A", "largest current that the drive gave in the last time step",
     [](const Twin& t, std::size_t i) { return t.drive(i).current_limit_A; }, true},
};

/// The input of a joint: its name, unit, meaning.
std::array<const char*, 3> input_of(RobotCommands commands) {
  switch (commands) {
    case RobotCommands::torque:
      return {"torque_command_nm", "Nm", "motor torque, arm side"};
    case RobotCommands::velocity:
      return {"velocity_command_rad_s", "rad/s", "set point of the speed loop"};
    default:
      return {"position_command_rad", "rad", "set point of the position loop"};
  }
}

}  // namespace

std::string_view name_of(RobotCommands commands) {
  return std::ranges::find(commands_table, commands, &std::pair<std::string_view, RobotCommands>::second)->first;
}

std::optional<RobotCommands> robot_commands(std::string_view name) {
  for (const auto& [known, commands] : commands_table)
    if (known == name) return commands;
  return {};
}

std::span<const RobotOutput> robot_outputs() { return outputs; }

DriveCommand robot_command(RobotCommands commands, double value) {
  switch (commands) {
    case RobotCommands::torque:
      return {.mode = DriveCommand::Mode::torque, .torque_nm = value};
    case RobotCommands::velocity:
      return {.mode = DriveCommand::Mode::velocity, .velocity_rad_s = value};
    default:
      return {.mode = DriveCommand::Mode::position, .position_rad = value};
  }
}

std::vector<FmuVariable> robot_variables(const Scenario& scenario, RobotCommands commands) {
  const mujoco::Model& model = *scenario.model;
  const std::vector<std::string> joints = joint_names(model);
  std::vector<FmuVariable> all{
      {.name = "time", .unit = "s", .meaning = "time", .kind = FmuKind::independent, .member = ""}};
  const auto slide = [&](std::size_t i) { return is_slide(model.get(), model.drives()[i]); };
  if (commands != RobotCommands::scenario)
    for (std::size_t i = 0; i < joints.size(); ++i) {
      const auto [name, unit, meaning] = input_of(commands);
      all.push_back({.name = joints[i] + "." + name,
                     .unit = unit_of(unit, slide(i)),
                     .meaning = meaning,
                     .kind = FmuKind::input,
                     .start = commands == RobotCommands::position ? scenario.start_rad[i] : 0,
                     .member = ""});
    }
  for (std::size_t i = 0; i < joints.size(); ++i)
    for (const RobotOutput& output : outputs)
      if (output.in(model.drives()[i].drive))
        all.push_back({.name = fmt::format("{}.{}", joints[i], output.name),
                       .unit = unit_of(output.unit, slide(i)),
                       .meaning = std::string(output.meaning),
                       .kind = FmuKind::output,
                       .member = ""});
  all.push_back({.name = "outside",
                 .unit = "",
                 .meaning = "in the last time step a joint was outside the range of its law",
                 .kind = FmuKind::output,
                 .member = ""});
  return all;
}

}  // namespace tribotwin::twin
