
#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/render/commands/program.hpp>

namespace tribotwin::render::program {

namespace fs = std::filesystem;

void write(const twin::Destination& output, std::string_view bytes) {
  twin::or_fail(twin::write_file(output.file, bytes, output.existing()));
  print_files(output, {output.file});
}

void print_files(const twin::Destination& output, const std::vector<std::string>& files) {
  if (output.json) return twin::print_text(twin::files_json(files));
  for (const auto& file : files) twin::print("{}\n", file);
}

std::vector<fs::path> run_files(const fs::path& directory) {
  return {directory / "telemetry.h5", directory / "scenario.yaml", directory / "summary.json"};
}

std::vector<fs::path> inputs(const std::vector<std::string>& files, const std::string& file) {
  std::vector<fs::path> all(files.begin(), files.end());
  all.emplace_back(file);
  return all;
}

std::optional<std::pair<int, int>> width_and_height(std::string_view size) {
  const auto cross = size.find('x');
  if (cross == size.npos) return std::nullopt;
  const auto width = to_integer<int>(size.substr(0, cross)), height = to_integer<int>(size.substr(cross + 1));
  if (!width || !height) return std::nullopt;
  return std::pair{*width, *height};
}

void add_units(CLI::App& command, twin::identification::ReadOptions& read) {
  command
      .add_option("--tau-max", read.torque_max_nm,
                  "Largest manipulation torque [Nm], arm side (default: that of PARAMS.yaml)")
      ->check(CLI::Range(1e-9, 1e9));
  command.add_option("--gear-ratio", read.gear_ratio, "Motor turns per joint turn (default: that of PARAMS.yaml)")
      ->check(CLI::Range(1e-6, 1e6));
}

}  // namespace tribotwin::render::program
