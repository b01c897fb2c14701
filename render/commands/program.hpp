#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/render/commands/table.hpp>
#include <tribotwin/twin/identification/samples/samples.hpp>
#include <tribotwin/twin/io/command_line/command_line.hpp>
#include <tribotwin/twin/io/destination.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/output.hpp>

/// What the commands of the program `tribotwin-report` share. A command is one file and one row of table.hpp.
namespace tribotwin::render::program {

/// Writes the file and names it on stdout.
void write(const twin::Destination& output, std::string_view bytes);

/// Names the files that were written on stdout, as JSON with --json.
void print_files(const twin::Destination& output, const std::vector<std::string>& files);

/// The files of a run that the program reads.
std::vector<std::filesystem::path> run_files(const std::filesystem::path& directory);

/// `files` and `file` as paths.
std::vector<std::filesystem::path> inputs(const std::vector<std::string>& files, const std::string& file);

/// "640x480" as its two numbers; nothing where it is written otherwise.
std::optional<std::pair<int, int>> width_and_height(std::string_view size);

/// The options --tau-max and --gear-ratio, which override those of PARAMS.yaml.
void add_units(CLI::App& command, twin::identification::ReadOptions& read);

}  // namespace tribotwin::render::program
