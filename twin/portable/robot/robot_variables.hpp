#pragma once

#include <string_view>
#include <vector>

#include <tribotwin/twin/portable/fmu_variables.hpp>
#include <tribotwin/twin/portable/robot/robot_fmu.hpp>
#include <tribotwin/twin/simulation/twin.hpp>

/// Internal to portable/robot: the variables of a robot's FMU. The exporter and the library both take them from here,
/// so value references agree.
namespace tribotwin::twin {

/// What a joint has: one row per output.
struct RobotOutput {
  std::string_view name, unit, meaning;
  double (*value)(const Twin&, std::size_t drive);
  bool of_winding = false;  ///< only joints whose motor has a winding have it
  bool in(const drive::Drive& drive) const { return !of_winding || drive.winding.present(); }
};
std::span<const RobotOutput> robot_outputs();

/// time; the inputs of all joints, where there are commands; the outputs of joint 0, joint 1, ...; the one Boolean.
std::vector<FmuVariable> robot_variables(const Scenario& scenario, RobotCommands commands);

/// The command of a drive whose input has this value.
DriveCommand robot_command(RobotCommands commands, double value);

}  // namespace tribotwin::twin
