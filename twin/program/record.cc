#include <memory>

#include <fmt/format.h>

#include <tribotwin/twin/program/program.hpp>
#include <tribotwin/twin/scenario/input.hpp>
#include <tribotwin/twin/telemetry/telemetry.hpp>

namespace tribotwin::twin::program {
namespace {

void require_record(const std::string& directory) {
  if (!std::filesystem::exists(std::filesystem::path(directory) / "telemetry.h5"))
    throw InputError(fmt::format("{}/telemetry.h5: does not exist", directory));
}

int recover_record(const std::string& directory) {
  require_record(directory);
  const auto result = recover(directory);
  if (!result) return complain(failed, result.error());
  if (result->was_complete) fmt::print("{}/telemetry.h5 is complete; there was nothing to recover\n", directory);
  else fmt::print("{}/telemetry.h5: {} samples up to {} s recovered\n", directory, result->samples, result->last_time_s);
  return done;
}

int export_record(const std::string& directory) {
  require_record(directory);
  Progress progress(false);
  const auto files = export_csv(directory, [&](double share) { progress(share); });
  if (!files) return complain(failed, files.error());
  for (const auto& file : *files) fmt::print("{}\n", file.string());
  return done;
}

}  // namespace

void add_recover(CLI::App& app, int& code) {
  auto directory = std::make_shared<std::string>();
  auto* command = app.add_subcommand("recover", "Turn the record of a killed run into a plain HDF5 file");
  command->add_option("RUNDIR", *directory, "Folder of the run")->required();
  command->footer("Example:\n  tribotwin recover runs/warmup");
  command->callback([directory, &code] { code = recover_record(*directory); });
}

void add_export(CLI::App& app, int& code) {
  struct Arguments {
    std::string directory;
    bool csv = false;
  };
  auto a = std::make_shared<Arguments>();
  auto* command = app.add_subcommand("export", "Write the record of a run as CSV");
  command->add_option("RUNDIR", a->directory, "Folder of the run")->required();
  command->add_flag("--csv", a->csv, "telemetry.csv and, where there are work cycles, cycles.csv")->required();
  command->footer("Example:\n  tribotwin export runs/warmup --csv");
  command->callback([a, &code] { code = export_record(a->directory); });
}

}  // namespace tribotwin::twin::program
