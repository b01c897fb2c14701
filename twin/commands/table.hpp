#pragma once

#include <tribotwin/twin/io/command_line/command_line.hpp>

/// The commands of the program `tribotwin`.
namespace tribotwin::twin::program {

/// Declares a command with its options on `app`. If the command is given, its callback does the work and leaves the
/// exit code in `code`; it throws errors (or_throw).
using AddCommand = void(CLI::App& app, int& code);

AddCommand add_run, add_curve, add_lab, add_identify, add_calibrate, add_dynamics, add_predict, add_excite, add_thermal,
    add_diagnose, add_fleet, add_sweep, add_recover, add_export, add_list, add_add_drives;

/// In the order of the help.
constexpr AddCommand* commands[] = {add_run,       add_sweep,    add_add_drives, add_curve,  add_lab,     add_identify,
                                    add_calibrate, add_dynamics, add_predict,    add_excite, add_thermal, add_diagnose,
                                    add_fleet,     add_recover,  add_export,     add_list};

}  // namespace tribotwin::twin::program
