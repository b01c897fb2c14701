#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/identification/curves/samples.hpp>
#include <tribotwin/twin/io/destination.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/output.hpp>

/// The commands of the program `tribotwin-report`, one file each. A command registers itself with its options; when it
/// was asked for, its callback does the work and leaves its exit code in the call. Wrong input is thrown as InputError.
namespace tribotwin::render::program {

/// One call of the program.
struct Call {
  std::string command_line;  ///< ready to be pasted into a shell; shown on pages
  int code = twin::done;
};

void add_report(CLI::App& app, Call& call);  ///< without a command: the page of runs
void add_pose(CLI::App& app, Call& call);
void add_curve(CLI::App& app, Call& call);
void add_fit(CLI::App& app, Call& call);
void add_diagnosis(CLI::App& app, Call& call);
void add_days(CLI::App& app, Call& call);
void add_study(CLI::App& app, Call& call);
void add_sheet(CLI::App& app, Call& call);
void add_video(CLI::App& app, Call& call);

/// Writes the file and names it on stdout.
void write(const twin::Destination& output, std::string_view bytes);

/// The files of a run that the program reads.
std::vector<std::filesystem::path> run_files(const std::filesystem::path& directory);

/// `files` and `file` as paths.
std::vector<std::filesystem::path> inputs(const std::vector<std::string>& files, const std::string& file);

/// "640x480" as its two numbers; nothing where it is written otherwise.
std::optional<std::pair<int, int>> width_and_height(std::string_view size);

/// The options --tau-max and --gear-ratio, which override those of PARAMS.yaml.
void add_units(CLI::App& command, twin::identification::ReadOptions& read);

}  // namespace tribotwin::render::program
