#include <charconv>

#include <tribotwin/render/commands/program.hpp>

namespace tribotwin::render::program {

namespace fs = std::filesystem;

void write(const twin::Destination& output, std::string_view bytes) {
  twin::or_fail(twin::write_file(output.file, bytes, output.existing()));
  twin::print("{}\n", output.file);
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
  std::pair<int, int> sides;
  const char *at = size.data(), *end = at + size.size();
  const auto first = std::from_chars(at, end, sides.first);
  if (first.ec != std::errc{} || first.ptr == end || *first.ptr != 'x') return std::nullopt;
  const auto second = std::from_chars(first.ptr + 1, end, sides.second);
  if (second.ec != std::errc{} || second.ptr != end) return std::nullopt;
  return sides;
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
