#pragma once

#include <atomic>
#include <filesystem>
#include <string>

#include <CLI/CLI.hpp>

#include <tribotwin/twin/output/output.hpp>

/// The commands of the program `tribotwin`, one file each. A command registers itself with its options; when it was asked
/// for, its callback does the work and leaves its exit code in `code`. Wrong input is thrown as InputError.
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
inline int complain(Exit code, const std::string& message) { return twin::complain("tribotwin", code, message); }

/// Set by SIGINT and SIGTERM from the first call on, a second one of which ends the program as ever; work that has lost its
/// sense may set it too.
std::atomic<bool>& interrupted();

/// The file of a campaign or scenario as given, or the shipped one of that name.
std::filesystem::path scenario_file(const std::string& given);

/// Text to stdout, or to `file` where one is named; returns the exit code.
int deliver(const std::string& text, const std::string& file);

}  // namespace tribotwin::twin::program
