#pragma once

#include <tribotwin/twin/io/command_line/command_line.hpp>

/// The commands of the program `tribotwin-hil`.
namespace tribotwin::hil::program {

/// Declares a command with its options on `app`. If the command is given, its callback does the work and leaves the
/// exit code in `code`; it throws errors (or_throw).
using AddCommand = void(CLI::App& app, int& code);

AddCommand add_drive, add_replay, add_shadow, add_budget, add_eds, add_dbc, add_ros2, add_conform;

/// In the order of the help.
constexpr AddCommand* commands[] = {add_drive, add_replay, add_shadow, add_budget,
                                    add_eds,   add_dbc,    add_ros2,   add_conform};

}  // namespace tribotwin::hil::program
