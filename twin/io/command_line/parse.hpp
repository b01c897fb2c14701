#pragma once

#include <exception>
#include <sstream>
#include <string_view>

#include <tribotwin/twin/io/command_line/command_line.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/output.hpp>

namespace tribotwin::twin::program {

/// Parses the arguments of a program and runs the callback of the command that they name, which leaves its exit code in
/// `code`. The one place where errors become messages on stderr and exit codes. Returns the exit code of
/// the program.
inline int parse(std::string_view program, CLI::App& app, int argc, const char* const* argv, int& code) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    std::ostringstream out, error;
    code = app.exit(e, out, error) == 0 ? done : wrong_input;
    print_text(out.str());
    report_text(error.str());
  } catch (const InputError& e) {
    code = report_error(program, wrong_input, e.what());
  } catch (const std::exception& e) {
    code = report_error(program, failed, e.what());
  }
  return finish(program, code);
}

}  // namespace tribotwin::twin::program
