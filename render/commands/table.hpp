#pragma once

#include <string>

#include <tribotwin/twin/io/command_line/command_line.hpp>
#include <tribotwin/twin/io/output.hpp>

/// The commands of the program `tribotwin-report`.
namespace tribotwin::render::program {

/// One call of the program.
struct Call {
  std::string command_line;  ///< ready to be pasted into a shell; shown on pages
  int code = twin::done;
};

/// Declares a command with its options on `app`. If the command is given, its callback does the work and leaves the
/// exit code in `call`; wrong input is thrown as InputError, other failures as std::runtime_error (or_throw).
using AddCommand = void(CLI::App& app, Call& call);

/// add_report is the program without a command: the page of runs.
AddCommand add_report, add_pose, add_curve, add_fit, add_thermal, add_dynamics, add_diagnosis, add_days, add_study,
    add_sweep, add_fleet, add_sheet, add_video;

/// In the order of the help.
constexpr AddCommand* commands[] = {add_report,   add_pose,      add_curve, add_fit,   add_thermal,
                                    add_dynamics, add_diagnosis, add_days,  add_study, add_sweep,
                                    add_fleet,    add_sheet,     add_video};

}  // namespace tribotwin::render::program
