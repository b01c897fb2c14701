// tribotwin: runs, measures and exports. stdout carries results only; everything else goes to stderr.
#include <algorithm>
#include <charconv>
#include <csignal>
#include <cstdio>
#include <iostream>

#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include <tribotwin/twin/laboratory/experiment.hpp>
#include <tribotwin/twin/output/output.hpp>
#include <tribotwin/twin/runtime/run.hpp>
#include <tribotwin/twin/telemetry/telemetry.hpp>

namespace {

using namespace tribotwin;
namespace fs = std::filesystem;

using twin::done, twin::failed, twin::wrong_input, twin::Exit, twin::Progress;

int complain(Exit code, const std::string& message) { return twin::complain("tribotwin", code, message); }

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
    const YAML::Node node = twin::load_yaml(file);
    if (node["model"]) fmt::print("{:<18} {}\n", file.stem().string(), node["description"].as<std::string>(""));
  }
  return done;
}

/// A file as given, or the shipped scenario of that name.
fs::path scenario_file(const std::string& given) {
  if (fs::is_regular_file(given) || given.find('/') != std::string::npos) return given;
  const fs::path shipped = scenario_folder() / (given + (given.ends_with(".yaml") ? "" : ".yaml"));
  return fs::exists(shipped) ? shipped : fs::path(given);
}

void print_summary(const twin::Summary& s, const fs::path& directory) {
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

/// FROM:TO:COUNT, evenly spaced.
std::vector<double> speeds_of(const std::string& text) {
  double parts[3];
  const char* at = text.data();
  const char* end = text.data() + text.size();
  for (int i = 0; i < 3; ++i) {
    const auto [next, error] = std::from_chars(at, end, parts[i]);
    if (error != std::errc{} || (i < 2 ? next == end || *next != ':' : next != end))
      throw twin::InputError(fmt::format("--speeds {}: must be FROM:TO:COUNT in motor rad/s, for example 1:280:50", text));
    at = next + 1;
  }
  const double count = parts[2];
  if (!(std::isfinite(parts[0]) && std::isfinite(parts[1])) || count < 1 || count > 1e6 || count != std::floor(count))
    throw twin::InputError(fmt::format("--speeds {}: FROM and TO must be finite and COUNT a whole number from 1 to 1000000", text));
  std::vector<double> speeds;
  for (int i = 0; i < static_cast<int>(count); ++i) speeds.push_back(count == 1 ? parts[0] : parts[0] + (parts[1] - parts[0]) * i / (count - 1));
  return speeds;
}

struct CurveArguments {
  std::string model, joint, speeds = "1:280:50", csv, load_by = "torque";
  double temperature = 50, load = 0, noise = 0;
  std::uint64_t seed = 1;
  bool experiment = false, quiet = false;
};

int curve(const CurveArguments& a) {
  const auto speeds = speeds_of(a.speeds);
  for (const auto& [option, value] : {std::pair{"--temperature", a.temperature}, {"--load", a.load}, {"--noise", a.noise}})
    if (!std::isfinite(value)) throw twin::InputError(fmt::format("{} {}: must be a finite number", option, value));
  const auto model = mujoco::load_file(a.model);
  if (!model) throw twin::InputError(model.error());
  const auto found = twin::find_drive(**model, a.joint);
  if (!found) throw twin::InputError(fmt::format("{}: --joint {}", a.model, found.error()));
  const std::size_t index = *found;
  const auto& drive = (*model)->drives()[index].drive;
  std::vector<twin::CurvePoint> points;
  if (a.experiment) {
    for (const double v : speeds)
      if (v == 0) throw twin::InputError("--speeds: a measurement needs a speed other than 0");
    Progress progress(a.quiet);
    auto measured = twin::measure_curve(**model, index, speeds,
                                        {.load_norm = a.load, .temperature_degC = a.temperature,
                                         .load_by = a.load_by == "pose" ? twin::LoadBy::pose : twin::LoadBy::torque,
                                         .noise_nm = a.noise, .seed = a.seed, .progress = [&](double share) { progress(share); }});
    if (!measured) return complain(a.load_by == "pose" && measured.error().starts_with("no pose") ? wrong_input : failed, measured.error());
    points = std::move(*measured);
  } else {
    points = twin::law_curve(drive, speeds, a.load, a.temperature);
  }
  int outside = 0;
  for (const auto& p : points)
    outside += friction::level(drive.law, friction::at_temperature(drive.law, p.temperature_degC), p.speed_rad_s / drive.gear_ratio * drive.speed_scale(), p.load_norm).outside;
  std::string text = "speed_rad_s,load_norm,temperature_degC,friction_norm,friction_nm,stderr_nm\n";
  for (const auto& p : points)
    text += fmt::format("{},{},{},{},{},{}\n", p.speed_rad_s, p.load_norm, p.temperature_degC, p.friction_norm, p.friction_nm, p.stderr_nm);
  if (outside && !a.quiet)
    fmt::print(stderr, "note: {} of {} points lie outside the range in which law '{}' was identified; its validity policy applies\n", outside, points.size(), drive.law.info->name);
  if (a.csv.empty()) {
    std::fwrite(text.data(), 1, text.size(), stdout);
    return std::fflush(stdout) == 0 ? done : complain(failed, "stdout cannot be written");
  }
  const auto written = twin::write_file(a.csv, text);
  return written ? done : complain(failed, written.error());
}

}  // namespace

int main(int argc, char** argv) {
  mujoco::install_message_handlers();
  std::signal(SIGXFSZ, SIG_IGN);   // a full disk is an error message, not a death

  CLI::App app{"tribotwin: a digital twin of robot joints whose friction knows load and temperature"};
  app.require_subcommand(1);
  app.set_version_flag("--version", std::string("tribotwin " TRIBOTWIN_VERSION ", MuJoCo ") + mj_versionString());

  std::string scenario, directory;
  std::vector<std::string> settings;
  std::optional<std::int64_t> seed;
  bool realtime = false, quiet = false, list = false, json = false;
  auto* run = app.add_subcommand("run", "Run a scenario: telemetry.h5, summary.json, scenario.yaml");
  run->add_option("SCENARIO", scenario, "Scenario file, or the name of a shipped one");
  run->add_option("-o,--output", directory, "Folder for the results (default: runs/NAME)");
  run->add_option("--seed", seed, "Seed of everything random");
  run->add_option("--set", settings, "key=value, dotted keys, in place of what the file says")->allow_extra_args(false);
  run->add_flag("--realtime", realtime, "Not faster than the clock");
  run->add_flag("--quiet", quiet, "No progress, no summary");
  run->add_flag("--json", json, "Print summary.json instead of the table");
  run->add_flag("--list", list, "List the shipped scenarios");
  run->footer("Example:\n  tribotwin run irb6620_warmup -o runs/warmup --set duration_s=3600");

  CurveArguments c;
  auto* curve_command = app.add_subcommand("curve", "Friction over speed: the law, or as an experiment measures it");
  curve_command->add_option("MODEL", c.model, "MJCF model")->required();
  curve_command->add_option("--joint", c.joint, "Joint with a drive")->required();
  curve_command->add_option("--temperature", c.temperature, "Lubricant temperature [degC]")->capture_default_str()->check(CLI::Range(-273.15, 1000.0));
  curve_command->add_option("--load", c.load, "Load torque / torque_max_nm [-]")->capture_default_str()->check(CLI::Range(-1000.0, 1000.0));
  curve_command->add_option("--speeds", c.speeds, "FROM:TO:COUNT, motor side [rad/s]")->capture_default_str();
  curve_command->add_flag("--experiment", c.experiment, "Measure in simulation by paper 1's +-v procedure");
  curve_command->add_option("--load-by", c.load_by, "What holds the load in the experiment")->check(CLI::IsMember({"torque", "pose"}))->capture_default_str();
  curve_command->add_option("--noise", c.noise, "Standard deviation of the measured motor torque, arm side [Nm]")->capture_default_str()->check(CLI::Range(0.0, 1e9));
  curve_command->add_option("--seed", c.seed, "Seed of the noise")->capture_default_str();
  curve_command->add_option("--csv", c.csv, "Write to this file instead of stdout");
  curve_command->add_flag("--quiet", c.quiet, "No progress, no notes");
  curve_command->footer("Example:\n  tribotwin curve mjcf/irb6620.xml --joint joint2 --temperature 50 --load 0.3 --speeds 1:280:10 --experiment");

  std::string run_directory;
  auto* recover = app.add_subcommand("recover", "Turn the record of a killed run into a plain HDF5 file");
  recover->add_option("RUNDIR", run_directory, "Folder of the run")->required();
  recover->footer("Example:\n  tribotwin recover runs/warmup");

  bool csv = false;
  auto* export_command = app.add_subcommand("export", "Write the record of a run as CSV");
  export_command->add_option("RUNDIR", run_directory, "Folder of the run")->required();
  export_command->add_flag("--csv", csv, "telemetry.csv and, where there are work cycles, cycles.csv")->required();
  export_command->footer("Example:\n  tribotwin export runs/warmup --csv");

  try {
    app.parse(argc, argv);
    if (*run) {
      if (list) return list_scenarios();
      if (scenario.empty()) return complain(wrong_input, "run needs a scenario; 'tribotwin run --list' names those that ship");
      if (seed) settings.push_back(fmt::format("seed={}", *seed));
      const twin::Scenario loaded = twin::load_scenario(scenario_file(scenario), settings);
      const fs::path output = directory.empty() ? fs::path("runs") / loaded.name : fs::path(directory);
      const auto summary = [&] {
        Progress progress(quiet);
        return twin::run(loaded, {.directory = output, .realtime = realtime, .progress = [&](double share, double left) { progress(share, left); }});
      }();
      if (!summary) return complain(failed, summary.error());
      if (json) fmt::print("{}", twin::summary_json(*summary));
      else if (!quiet) print_summary(*summary, output);
      return done;
    }
    if (*curve_command) return curve(c);
    if (*recover) {
      if (!fs::exists(fs::path(run_directory) / "telemetry.h5")) return complain(wrong_input, fmt::format("{}/telemetry.h5: does not exist", run_directory));
      const auto result = twin::recover(run_directory);
      if (!result) return complain(failed, result.error());
      if (result->was_complete) fmt::print("{}/telemetry.h5 is complete; there was nothing to recover\n", run_directory);
      else fmt::print("{}/telemetry.h5: {} samples up to {} s recovered\n", run_directory, result->samples, result->last_time_s);
      return done;
    }
    if (!fs::exists(fs::path(run_directory) / "telemetry.h5")) return complain(wrong_input, fmt::format("{}/telemetry.h5: does not exist", run_directory));
    Progress progress(false);
    const auto files = twin::export_csv(run_directory, [&](double share) { progress(share); });
    if (!files) return complain(failed, files.error());
    for (const auto& file : *files) fmt::print("{}\n", file.string());
    return done;
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? done : wrong_input;
  } catch (const twin::InputError& e) {
    return complain(wrong_input, e.what());
  } catch (const std::exception& e) {
    return complain(failed, e.what());
  }
}
