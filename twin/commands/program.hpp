#pragma once

#include <filesystem>
#include <string>

#include <CLI/CLI.hpp>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/destination.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/output.hpp>

/// The commands of the program `tribotwin`, one file each. A command registers itself with its options; when it was
/// asked for, its callback does the work and leaves its exit code in `code`. Wrong input is thrown as InputError.
namespace tribotwin::twin::program {

void add_run(CLI::App& app, int& code);
void add_curve(CLI::App& app, int& code);
void add_lab(CLI::App& app, int& code);
void add_identify(CLI::App& app, int& code);
void add_recover(CLI::App& app, int& code);
void add_export(CLI::App& app, int& code);
void add_calibrate(CLI::App& app, int& code);
void add_diagnose(CLI::App& app, int& code);
void add_dynamics(CLI::App& app, int& code);
void add_predict(CLI::App& app, int& code);
void add_excite(CLI::App& app, int& code);
void add_thermal(CLI::App& app, int& code);

/// "tribotwin: MESSAGE" on stderr; returns the exit code.
inline int report_error(Exit code, const std::string& message) {
  return twin::report_error("tribotwin", code, message);
}

/// The file of a campaign or scenario as given, or the shipped one of that name.
std::filesystem::path scenario_file(const std::string& given);

/// Before any work: throws InputError where -o names what cannot be written or is one of `inputs`.
inline void check(const Destination& output, const std::vector<std::filesystem::path>& inputs) {
  or_wrong_input(output.check(inputs));
}
inline std::vector<std::filesystem::path> paths(const std::vector<std::string>& files) {
  return {files.begin(), files.end()};
}

/// Writes the result to where it goes; returns the exit code.
inline int deliver(const std::string& text, const Destination& output = {}) {
  return output.deliver("tribotwin", text);
}

}  // namespace tribotwin::twin::program
