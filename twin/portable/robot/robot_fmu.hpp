#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/twin/portable/fmu.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

/// A whole robot, MuJoCo inside, as FMU for co-simulation: the twin of a scenario. Its library is built with the
/// programs; the scenario, the model and whatever these name are the FMU's resources.
namespace tribotwin::twin {

/// Who moves the drives: the scenario's own motion and control, or one input per joint.
enum class RobotCommands { scenario, torque, velocity, position };

/// As in options and files.
std::string_view name_of(RobotCommands commands);
std::optional<RobotCommands> robot_commands(std::string_view name);

/// The files of the FMU, its library among them. Fails where the scenario names what cannot be part of it.
Result<std::vector<FmuFile>> robot_fmu_files(const Scenario& scenario, RobotCommands commands, const std::string& name,
                                             FmiVersion version, const std::filesystem::path& library);

/// libtribotwin_robot_fmu.so, beside the program in the build tree or where it is installed; empty where it is not.
std::filesystem::path robot_fmu_library();

}  // namespace tribotwin::twin
