#pragma once

#include <string>

#include <tribotwin/twin/io/command_line/command_line.hpp>

namespace tribotwin::twin::program {

/// Parses the arguments of a program and runs the callback of the command that they name, which leaves its exit code in
/// `code`. The one place where errors become messages on stderr and exit codes. Returns the exit code of the program.
/// A program alone, or a command that needs another one, prints its help on stderr: wrong usage, exit code 2.
/// `engine`: MuJoCo's version. `values`: what completion offers for options beside what ships and the laws.
int parse(const std::string& program, const std::string& engine, CLI::App& app, int argc, const char* const* argv,
          int& code, const CLI::CompletionValues& values = {});

}  // namespace tribotwin::twin::program
