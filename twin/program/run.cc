#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>

#include <fmt/format.h>

#include <tribotwin/twin/program/program.hpp>
#include <tribotwin/twin/runtime/run.hpp>

namespace tribotwin::twin::program {
namespace {

namespace fs = std::filesystem;

/// The folder of shipped scenarios: beside the source tree or installed.
fs::path scenario_folder() {
  for (const char* folder : {TRIBOTWIN_SCENARIOS_BUILD, TRIBOTWIN_SCENARIOS_INSTALLED})
    if (fs::is_directory(folder)) return folder;
  return {};
}

int list_scenarios() {
  std::vector<fs::path> files;
  const fs::path folder = scenario_folder();
  if (folder.empty()) return complain(failed, "the shipped scenarios are not where they were built or installed");
  for (const auto& entry : fs::directory_iterator(folder))
    if (entry.path().extension() == ".yaml") files.push_back(entry.path());
  std::ranges::sort(files);
  for (const auto& file : files) {
    const YAML::Node node = load_yaml(file);
    if (node["model"]) fmt::print("{:<18} {}\n", file.stem().string(), node["description"].as<std::string>(""));
  }
  return done;
}

void print_summary(const Summary& s, const fs::path& directory) {
  fmt::print("simulated {:.1f} s in {:.2f} s ({:.0f} x real time), {} of {} steps computed\n", s.simulated_s, s.wall_s,
             s.simulated_s / std::max(s.wall_s, 1e-9), s.steps_computed, s.steps);
  fmt::print("friction work {:.6g} J, heat {:.6g} J, energy balance {:.2g} J\n", s.friction_work_J, s.heat_J, s.energy_balance_J);
  fmt::print("{:<12} {:>28} {:>24} {:>10} {:>10} {:>10}\n", "joint", "temperature [degC]", "friction [Nm]", "load [-]", "clamped", "stuck [s]");
  for (const auto& j : s.joints)
    fmt::print("{:<12} {:>8.2f} ->{:>7.2f} max{:>7.2f} {:>9.4g} rms{:>9.4g} max {:>9.3f} {:>10} {:>10.2f}\n", j.name, j.temperature_degC.start,
               j.temperature_degC.end, j.temperature_degC.max, j.friction_nm.rms, j.friction_nm.max, j.load_max_norm, j.clamped_samples, j.stuck_s);
  if (s.comparison)
    fmt::print("MAE against the recording: {:.1f} mrad; the same twin with MuJoCo's frictionloss and damping: {:.1f} mrad\n",
               s.comparison->mae_mrad, s.comparison->baseline_mae_mrad);
  for (const auto& warning : s.warnings) fmt::print(stderr, "note: {}\n", warning);
  if (!directory.empty()) fmt::print("written: {0}/telemetry.h5, {0}/summary.json, {0}/scenario.yaml\n", directory.string());
}

struct Arguments {
  std::string scenario, directory;
  std::vector<std::string> settings;
  std::optional<std::int64_t> seed;
  bool realtime = false, quiet = false, list = false, json = false;
};

int execute(const Arguments& a) {
  if (a.list) return list_scenarios();
  if (a.scenario.empty()) return complain(wrong_input, "run needs a scenario; 'tribotwin run --list' names those that ship");
  std::vector<std::string> settings = a.settings;
  if (a.seed) settings.push_back(fmt::format("seed={}", *a.seed));
  const Scenario loaded = load_scenario(scenario_file(a.scenario), settings);
  const fs::path output = a.directory.empty() ? fs::path("runs") / loaded.name : fs::path(a.directory);
  const auto summary = [&] {
    Progress progress(a.quiet);
    return twin::run(loaded, {.directory = output, .realtime = a.realtime, .progress = [&](double share, double left) { progress(share, left); }});
  }();
  if (!summary) return complain(failed, summary.error());
  if (a.json) fmt::print("{}", summary_json(*summary));
  else if (!a.quiet) print_summary(*summary, output);
  return done;
}

}  // namespace

/// A file as given, or the shipped scenario of that name.
fs::path scenario_file(const std::string& given) {
  if (fs::is_regular_file(given) || given.find('/') != std::string::npos) return given;
  const fs::path shipped = scenario_folder() / (given + (given.ends_with(".yaml") ? "" : ".yaml"));
  return fs::exists(shipped) ? shipped : fs::path(given);
}

void add_run(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* run = app.add_subcommand("run", "Run a scenario: telemetry.h5, summary.json, scenario.yaml");
  run->add_option("SCENARIO", a->scenario, "Scenario file, or the name of a shipped one");
  run->add_option("-o,--output", a->directory, "Folder for the results (default: runs/NAME)");
  run->add_option("--seed", a->seed, "Seed of everything random");
  run->add_option("--set", a->settings, "key=value, dotted keys, in place of what the file says")->allow_extra_args(false);
  run->add_flag("--realtime", a->realtime, "Not faster than the clock");
  run->add_flag("--quiet", a->quiet, "No progress, no summary");
  run->add_flag("--json", a->json, "Print summary.json instead of the table");
  run->add_flag("--list", a->list, "List the shipped scenarios");
  run->footer("Example:\n  tribotwin run irb6620_warmup -o runs/warmup --set duration_s=3600");
  run->callback([a, &code] { code = execute(*a); });
}

}  // namespace tribotwin::twin::program
