#pragma once

#include <optional>
#include <string>

#include <tribotwin/twin/commands/joint_source.hpp>
#include <tribotwin/twin/commands/program.hpp>

/// What `export` writes of one joint or a robot, for other tools. Wrong input is thrown.
namespace tribotwin::twin::program {

/// C and FMUs: without `name`, what names begin with is the model's joint.
Result<Exit> export_c(const JointSource& source, const std::string& name, const Destination& output);
Result<Exit> export_fmu(const JointSource& source, const std::string& name, int fmi_version, const Destination& output);

/// Friction as BAM's m4; how far it is off and what is lost is said.
Result<Exit> export_bam(const JointSource& source, const std::string& actuator, std::optional<double> temperature_degC,
                        std::optional<double> speed_max_rad_s, const Destination& output);

/// A robot with all its joints: the twin of a scenario. `commanded`: RobotCommands by name.
Result<Exit> export_robot_fmu(const std::string& scenario, const std::string& name, const std::string& commanded,
                              int fmi_version, const Destination& output);
/// Whether --fmu makes a robot of this file: a scenario, also one that ships.
bool is_scenario(const std::string& file);

/// A table of friction over speed, load and temperature; what is lost is said.
Result<Exit> export_table(const JointSource& source, std::optional<double> temperature_degC,
                          std::optional<double> speed_max_rad_s, const Destination& output);

/// The <dynamics> elements of a URDF for all joints of a model with drives.
Result<Exit> export_urdf(const std::string& file, std::optional<double> temperature_degC,
                         std::optional<double> speed_max_rad_s, const Destination& output);

}  // namespace tribotwin::twin::program
