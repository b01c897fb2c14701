#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <ctime>
#include <memory>
#include <new>
#include <numeric>
#include <optional>
#include <span>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <sys/mman.h>

#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/experiments/unfinished_runs.hpp>
#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/io/telemetry/run_folder.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/live/twin_feed.hpp>
#include <tribotwin/twin/live/web_options.hpp>
#include <tribotwin/twin/numerics/executor/executor.hpp>
#include <tribotwin/twin/numerics/executor/mpi.hpp>
#include <tribotwin/twin/robot/arm.hpp>
#include <tribotwin/twin/simulation/run.hpp>

namespace tribotwin::twin::program {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

Result<Exit> list_scenarios() {
  const auto files = shipped_scenarios();
  TextTable table{{TextTable::left(), TextTable::left()}};
  if (files.empty()) return work_failed("the shipped scenarios are not where they were built or installed");
  for (const auto& file : files) {
    const YAML::Node node = load_yaml(file);
    if (node["model"] && !node["procedure"]) table.add({file.stem().string(), node["description"].as<std::string>("")});
  }
  print_text(table.text());
  return done;
}

/// "warning: ..." or "note: ...", of one of several runs with its folder.
std::string health_message(const HealthLine& line, const std::string& folder = {}) {
  return fmt::format("{}: {}{}{}\n", name(line.verdict), folder, folder.empty() ? "" : ": ", line.text);
}

void report_health(const std::vector<HealthLine>& lines) {
  for (const HealthLine& line : lines) report_text(health_message(line));
}

/// What model and scenario say before a run that may take hours.
void report_before(const Scenario& scenario) {
  report_health(health_lines(examine({scenario, nullptr, predicted_bytes(scenario)})));
}

/// What only the run could say.
std::vector<HealthLine> of_run(const Summary& s) {
  std::vector<HealthLine> lines = health_lines(s.health);
  std::erase_if(lines, [](const HealthLine& line) {
    return std::ranges::find(health_checks(), line.check, &HealthCheck::name)->before_run;
  });
  return lines;
}

/// The checks that found a warning: "ctrlrange, saturation".
std::string checks_that_warn(const Summary& s) {
  std::vector<std::string> checks;
  for (const HealthLine& line : health_lines(s.health))
    if (line.verdict == Verdict::warning) checks.push_back(line.check);
  return joined(checks);
}

/// Of joints that carry nothing the integrator leaves 1e-9 Nm, which is no friction.
std::string friction_text(double nm) { return nm < 1e-6 ? "0" : fmt::format("{:.4g}", nm); }

std::string table_of(const Summary& s) {
  constexpr auto right = TextTable::right;
  const auto percent = [&s](double seconds) {
    return fmt::format("{:.3g}", 100 * seconds / std::max(s.simulated_s, 1e-9));
  };
  TextTable table{{TextTable::left("joint"), right("start [degC]"), right("end [degC]"), right("max [degC]"),
                   right("friction rms"), right("max"), TextTable::left(), right("load max [-]"),
                   right("outside law [%]"), right("stuck [%]")}};
  for (const auto& j : s.joints)
    table.add({j.name, fmt::format("{:.2f}", j.temperature_degC.start), fmt::format("{:.2f}", j.temperature_degC.end),
               fmt::format("{:.2f}", j.temperature_degC.max), friction_text(j.friction_nm.rms),
               friction_text(j.friction_nm.max), unit_of("Nm", j.slide), fmt::format("{:.3f}", j.load_max_norm),
               percent(j.outside_s), percent(j.stuck_s)});
  return table.text();
}

/// What windings have to do with the heat: their share of it, and a line for each.
void print_windings(const Summary& s) {
  for (const auto& j : s.joints)
    if (const auto& w = j.winding)
      print("winding of {}: {:.2f} degC at the start, {:.2f} at the end, {:.2f} at most; copper loss {:.6g} J\n",
            j.name, w->start_degC, w->end_degC, w->max_degC, w->copper_loss_J);
}

std::string share_of_windings(const Summary& s) {
  double to_gears_J = 0;
  bool any = false;
  for (const auto& j : s.joints)
    if (const auto& w = j.winding) to_gears_J += w->to_gear_J, any = true;
  if (!any) return "";
  return fmt::format(" ({:.6g} J, {:.3g} %, from windings)", to_gears_J,
                     s.heat_J != 0 ? 100 * to_gears_J / s.heat_J : 0);
}

void print_summary(const Summary& s, const fs::path& directory) {
  print("simulated {:.1f} s in {:.2f} s ({:.0f} x real time), {} of {} steps computed\n", s.simulated_s, s.wall_s,
        s.simulated_s / std::max(s.wall_s, 1e-9), s.steps_computed, s.steps);
  print("friction work {:.6g} J, heat {:.6g} J{}, energy balance {:.2g} J\n", s.friction_work_J, s.heat_J,
        share_of_windings(s), s.energy_balance_J);
  print_text(table_of(s));
  print_windings(s);
  if (s.comparison)
    print("MAE against the recording: {:.1f} mrad; the same twin with MuJoCo's frictionloss and damping: {:.1f} mrad\n",
          s.comparison->mae_mrad, s.comparison->baseline_mae_mrad);
  report_health(of_run(s));
  for (const auto& warning : s.warnings) note("{}", warning);
  if (!as_asked(s.health))
    report_text(fmt::format("warning: the run is not what its scenario asked for ({})\n", checks_that_warn(s)));
  if (!directory.empty()) print("written: {0}/telemetry.h5, {0}/summary.json, {0}/scenario.yaml\n", directory.string());
}

/// What is to be said of one of several runs, and its part of their summary.json: text, because another rank may have
/// run it.
Json report_of(const VariedRun& run) {
  std::string line =
      fmt::format("{:<24} simulated {:.1f} s in {:.2f} s", run.folder, run.summary.simulated_s, run.summary.wall_s);
  for (const auto& t : run.summary.tracking)
    line += fmt::format("; error {:.3f} mrad, at standstill {:.4f} mrad peak to peak", t.l1_mrad, t.standstill_pp_mrad);
  for (const auto& l : run.summary.loops)
    line += fmt::format("; loop {:.4g} J, {:.4g} Nm/rad", l.area_J, l.stiffness_nm_rad);
  Json report{{"line", line + "\n"}, {"messages", Json::array()}, {"summary", Json::parse(varied_json({&run, 1}))}};
  for (const HealthLine& health : health_lines(run.summary.health))
    report["messages"].push_back(health_message(health, run.folder));
  for (const auto& warning : run.summary.warnings)
    report["messages"].push_back(fmt::format("note: {}: {}\n", run.folder, warning));
  if (!as_asked(run.summary.health)) report["failing"] = run.folder + ": " + checks_that_warn(run.summary);
  return report;
}

/// One summary.json of all: lists are joined.
std::string varied_summary(const std::vector<Json>& reports) {
  Json all = reports.front()["summary"];
  for (std::size_t i = 1; i < reports.size(); ++i)
    for (const auto& [key, list] : reports[i]["summary"].items())
      for (const Json& entry : list) all[key].push_back(entry);
  return dump_json(all, 2) + "\n";
}

void print_varied(const std::vector<Json>& reports, const fs::path& directory) {
  for (const Json& report : reports) {
    print("{}", report["line"].get<std::string>());
    for (const Json& message : report["messages"]) report_text(message.get<std::string>());
  }
  print("written: {0}/summary.json and the folders of {1} runs\n", directory.string(), reports.size());
}

/// One run of a scenario that varies: the settings that make it, and the folder below that of the whole.
struct Variation {
  std::string folder;
  std::vector<std::string> settings;
};

/// Every combination of the values that a mapping under `vary` lists for its keys, mapping by mapping; none without
/// `vary`.
std::vector<Variation> variations(const fs::path& file) {
  std::vector<Variation> all;
  const YAML::Node root = load_yaml(file), vary = root["vary"];
  if (!vary) return all;
  const auto fail_at = [&](const YAML::Node& node, const std::string& why) {
    throw InputError(fmt::format("{}:{}: vary: {}", file.string(), node.Mark().line + 1, why));
  };
  const auto fail = [&](const std::string& why) {
    fail_at(vary, why + ", for example vary: [{temperature_degC: [20, 35]}]");
  };
  if (!vary.IsSequence() || vary.size() == 0) fail("must be a list of mappings from keys to lists of values");
  for (const auto& set : vary) {
    if (!set.IsMap()) fail("must be a list of mappings from keys to lists of values");
    std::vector<Variation> product{{}};
    for (const auto& entry : set) {
      if (!entry.first.IsScalar() || entry.first.Scalar().empty()) fail("has a key that is no name");
      const std::string key = entry.first.Scalar();
      if (!entry.second.IsSequence() || entry.second.size() == 0)
        fail(fmt::format("has no list of values for '{}'", key));
      std::vector<Variation> longer;
      for (const Variation& one : product)
        for (const auto& value : entry.second) {
          if (!value.IsScalar()) fail(fmt::format("has a value of '{}' that is no number or word", key));
          Variation more = one;
          more.folder += (one.folder.empty() ? "" : "_") + fs::path(value.Scalar()).filename().string();
          more.settings.push_back(key + "=" + value.Scalar());
          if (const auto why = unfit_file_name(more.folder))
            fail_at(value, fmt::format("{}: {} makes the folder {}", key, value.Scalar(), *why));
          longer.push_back(std::move(more));
        }
      product = std::move(longer);
    }
    for (Variation& one : product) {
      if (std::ranges::find(all, one.folder, &Variation::folder) != all.end())
        fail(fmt::format("gives two runs the folder '{}'", one.folder));
      all.push_back(std::move(one));
    }
  }
  return all;
}

struct Arguments {
  std::string scenario, directory;
  std::vector<std::string> settings;
  std::optional<std::int64_t> seed;
  unsigned threads = 0;
  int retries = 1;
  bool realtime = false, quiet = false, list = false, json = false, force = false, strict = false;
  live::WebOptions web;
};

/// The scenario.yaml of an earlier run is not replaced by the run that reads it.
void require_other_folder(const fs::path& output, const fs::path& scenario) {
  std::error_code error;
  if (fs::equivalent(output / "scenario.yaml", scenario, error))
    throw InputError(
        fmt::format("-o {}: the scenario that is read lies in it; choose another folder", output.string()));
}

/// `checks`: those that found a warning.
Result<Exit> strict_code(const Arguments& a, const std::string& checks) {
  if (checks.empty() || !a.strict) return done;
  return report_error(limit_exceeded, fmt::format("--strict: the run is not what its scenario asked for ({})", checks));
}

/// How a recorded motion was understood.
void note_recording(const Arguments& a, const Scenario& scenario) {
  if (!scenario.recording || a.quiet) return;
  for (const auto& text : scenario.recording->notes) note("{}", text);
}

std::time_t wall_clock() { return std::time(nullptr); }

/// The progress of several runs, each in a process of its own, on one line.
class SharedProgress {
 public:
  SharedProgress(bool quiet, std::size_t runs) : progress_(quiet) {
    size_ = runs * sizeof(Share);
    void* memory = ::mmap(nullptr, size_, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) throw std::bad_alloc();
    share_ = {new (memory) Share[runs]{}, runs};
  }
  SharedProgress(const SharedProgress&) = delete;
  ~SharedProgress() { ::munmap(share_.data(), size_); }
  /// In any process.
  void set(std::size_t run, double share) { share_[run] = share; }
  void show() {
    const double whole = std::accumulate(share_.begin(), share_.end(), 0.0) / static_cast<double>(share_.size());
    const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - started_;
    progress_(whole, whole > 0 ? spent.count() * (1 / whole - 1) : -1);
  }

 private:
  using Share = std::atomic<double>;
  static_assert(Share::is_always_lock_free, "several processes use it");
  Progress progress_;
  std::size_t size_ = 0;
  std::span<Share> share_;
  const std::chrono::steady_clock::time_point started_ = std::chrono::steady_clock::now();
};

/// The scenario of each variation. All are read before the first runs: what is wrong with the last is said at once.
std::vector<Scenario> scenarios_of(const Arguments& a, const fs::path& file, const std::vector<Variation>& all,
                                   const std::vector<std::string>& settings) {
  std::vector<Scenario> scenarios;
  for (const Variation& one : all) {
    std::vector<std::string> both = one.settings;
    both.insert(both.end(), settings.begin(), settings.end());
    scenarios.push_back(or_throw(load_scenario(file, both)));
    note_recording(a, scenarios.back());
  }
  return scenarios;
}

/// Runs those that are missing on all threads and ranks; each rank writes the folders of its runs. A report per run.
Result<Outcome> run_all(const Arguments& a, const std::vector<Variation>& all, const std::vector<Scenario>& scenarios,
                        const fs::path& output, UnfinishedRuns& unfinished) {
  SharedProgress progress(a.quiet, all.size());
  const std::string identity = identity_of(scenarios);
  const auto resumed = ranks().from_root([&]() -> Result<std::string> {
    std::vector<std::string> folders;
    for (const Variation& one : all) folders.push_back(one.folder);
    auto opened = UnfinishedRuns::open(output, folders, identity, a.force);
    if (!opened) return tl::unexpected(opened.error());
    unfinished = *std::move(opened);
    return unfinished.resumed() ? "resumed" : "";
  });
  if (!resumed) return tl::unexpected(resumed.error());
  const bool leftovers = a.force || !resumed->empty();
  std::vector<int> attempts(all.size());
  constexpr std::string_view again = "again";
  const Tasks tasks{.count = all.size(),
                    .identity = identity,
                    .work = [&](std::size_t i, const std::string& attempt) -> Result<std::string> {
                      if (attempt == again || !resumed->empty()) UnfinishedRuns::clear(output / all[i].folder);
                      const auto summary = twin::run(
                          scenarios[i], {.directory = output / all[i].folder,
                                         .existing = replace_if(leftovers || attempt == again),
                                         .realtime = a.realtime,
                                         .stop = &interrupted(),
                                         .progress = [&](double share, double) { progress.set(i, share); },
                                         .complete =
                                             [&](const Summary& whole) {
                                               return UnfinishedRuns::announce(
                                                   output, all[i].folder, summary_json(whole),
                                                   dump_json(report_of({all[i].folder, all[i].settings, whole})));
                                             },
                                         .now = wall_clock});
                      if (!summary) return tl::unexpected(summary.error());
                      if (summary->interrupted) return work_failed("interrupted");
                      return dump_json(report_of({all[i].folder, all[i].settings, *summary}));
                    },
                    .own_processes = true,
                    .present = [&](std::size_t i) { return unfinished.find(all[i].folder); },
                    .keep = [&](std::size_t i, const std::string& report) -> Result<void> {
                      progress.set(i, 1);
                      return unfinished.keep(all[i].folder, report);
                    },
                    // Wrong input is not tried again: what the folder holds then is of an attempt before.
                    .input = [&](std::size_t i) { return std::string(attempts[i]++ ? again : ""); },
                    .meanwhile = [&] { progress.show(); }};
  auto outcome =
      carry_out(tasks, {.threads = a.realtime ? 1 : a.threads, .retries = a.retries, .stop = &interrupted()});
  const auto written = ranks().on_root([&]() -> Result<void> {
    if (!outcome) return {};
    return write_failures(
        output, outcome->failures, [&](std::size_t i) { return all[i].folder; },
        [&](std::size_t i) { return joined(all[i].settings); });
  });
  if (!written) return work_failed(written.error().message);
  return outcome;
}

/// Why not all have run.
tl::unexpected<Error> not_all(const Outcome& outcome, const std::vector<Variation>& all) {
  const auto folder = [&](std::size_t i) { return all[i].folder; };
  const auto complete =
      fmt::format("{} of {} runs are complete, and the same command goes on",
                  std::ranges::count_if(outcome.results, [](const auto& r) { return !r.empty(); }), all.size());
  if (!outcome.failures.empty())
    return tl::unexpected(
        Error(fmt::format("{}; {}", text_of(outcome.failures, folder), complete), outcome.failures.front().error.kind));
  const auto first = std::ranges::find(outcome.results, "") - outcome.results.begin();
  return work_failed(fmt::format("{}: interrupted; {}", folder(static_cast<std::size_t>(first)), complete));
}

/// Runs all variations, each in a folder of its own, and one summary over them.
Result<Exit> vary(const Arguments& a, const fs::path& file, const std::vector<Variation>& all,
                  const std::vector<std::string>& settings) {
  const std::vector<Scenario> scenarios = scenarios_of(a, file, all, settings);
  const fs::path output = a.directory.empty() ? fs::path("runs") / scenarios[0].name : fs::path(a.directory);
  RunFolder folder;
  or_throw(ranks().on_root([&] {
    require_other_folder(output, file);
    return folder.open(output, replace_if(a.force));
  }));
  UnfinishedRuns unfinished;
  const auto outcome = run_all(a, all, scenarios, output, unfinished);
  if (!outcome) return tl::unexpected(outcome.error());
  // A stop may come after the last run.
  if (!outcome->failures.empty() || std::ranges::find(outcome->results, "") != outcome->results.end())
    return not_all(*outcome, all);
  if (!ranks().root()) return done;
  std::vector<Json> reports;
  for (const std::string& result : outcome->results) reports.push_back(Json::parse(result));
  const std::string summary = varied_summary(reports);
  if (const auto ok = unfinished.close(); !ok) return work_failed(ok.error().message);
  if (const auto ok = write_file(output / "summary.json", summary, Existing::refuse); !ok)
    return work_failed(ok.error().message);
  folder.commit();
  unfinished.forget();
  if (outcome->present && !a.quiet) note("{} of {} runs are those of an earlier call", outcome->present, all.size());
  if (a.json)
    print("{}", summary);
  else if (!a.quiet)
    print_varied(reports, output);
  std::vector<std::string> failing;
  for (const Json& report : reports)
    if (report.contains("failing")) failing.push_back(report["failing"]);
  return strict_code(a, joined(failing, "; "));
}

/// A robot is not yet work for it.
void refuse_model(const std::string& given) {
  const fs::path file(given);
  std::error_code error;
  const auto same = [&](const fs::path& model) { return model.stem() == file; };
  const bool ships = std::ranges::any_of(shipped_models(), same) && !fs::exists(file, error);
  if (file.extension() != ".xml" && file.extension() != ".urdf" && !ships) return;
  throw InputError(fmt::format(
      "{0}: is a model, and run needs a scenario, which says what the robot does. If its joints have no drives yet: "
      "'tribotwin add-drives {0} -o OUT.xml' adds them and writes OUT.yaml, a first hour of work; else write a "
      "scenario "
      "with 'model: {0}' ('tribotwin list scenarios' shows examples)",
      given));
}

/// One run, and its page if one is asked for.
Summary simulate(const Arguments& a, const Scenario& scenario, const fs::path& output) {
  auto hello = live::hello_of(scenario, "run", TRIBOTWIN_VERSION);
  live::TwinFeed::add_commands(hello);
  const auto server = a.web.start(std::move(hello), output);
  std::optional<live::TwinFeed> feed;
  if (server) feed.emplace(*server, !output.empty());
  Progress progress(a.quiet);
  RunOptions options{.directory = output,
                     .existing = replace_if(a.force),
                     .realtime = a.realtime,
                     .stop = &interrupted(),
                     .progress = [&](double share, double left) { progress(share, left); },
                     .now = wall_clock};
  if (feed) {
    options.sample = [&](const Twin& twin, double time_s) { feed->sample(twin, time_s); };
    options.held = [&](RunningTwin& run) { return feed->held(run); };
  }
  return or_throw(twin::run(scenario, options));
}

Result<Exit> execute(const Arguments& a) {
  if (a.list) return list_scenarios();
  if (const auto ok = join_ranks(); !ok) return tl::unexpected(ok.error());
  catch_interrupts();
  if (a.scenario.empty())
    return tl::unexpected(Error("run needs a scenario; 'tribotwin run --list' names those that ship"));
  std::vector<std::string> settings = a.settings;
  if (a.seed) settings.push_back(fmt::format("seed={}", *a.seed));
  const fs::path file = given_or_shipped(a.scenario, ".yaml");
  if (file == a.scenario) refuse_model(a.scenario);
  if (const auto all = variations(file); !all.empty()) {
    if (a.web.given())
      throw InputError(fmt::format("--web: shows one run, and {} has {} ('vary')", file.string(), all.size()));
    return vary(a, file, all, settings);
  }
  if (!ranks().root()) return done;
  if (ranks().several()) note("one run has nothing to divide: rank 0 of {} works alone", ranks().size());
  const Scenario loaded = or_throw(load_scenario(file, settings));
  note_recording(a, loaded);
  const fs::path output = a.directory.empty() ? fs::path("runs") / loaded.name : fs::path(a.directory);
  require_other_folder(output, file);
  if (!a.quiet && !a.json) report_before(loaded);
  const Summary summary = simulate(a, loaded, output);
  if (a.json)
    print("{}", summary_json(summary));
  else if (!a.quiet)
    print_summary(summary, output);
  if (summary.interrupted)
    return work_failed(fmt::format("interrupted at {:.6g} of {:.6g} s; the record in {} is complete until then",
                                   summary.simulated_s, loaded.duration_s, output.string()));
  return strict_code(a, checks_that_warn(summary));
}

}  // namespace

void add_run(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* run = app.add_subcommand("run", "Run a scenario: telemetry.h5, summary.json, scenario.yaml");
  run->add_option("SCENARIO", a->scenario, "Scenario file, or the name of a shipped one");
  run->add_option("-o,--output", a->directory, "Folder for the results (default: runs/NAME)");
  run->add_option("--seed", a->seed, "Seed of all random numbers");
  run->add_option("--set", a->settings, "key=value with dotted keys; overrides the file")->allow_extra_args(false);
  run->add_flag("--force", a->force, "Replace a run that the folder holds, once the new one is complete");
  run->add_flag("--strict", a->strict,
                "Exit code 3 if the health check warns: the run is not what its scenario asked for");
  run->add_flag("--realtime", a->realtime, "Run no faster than real time");
  a->web.add_to(*run);
  run->add_option("--threads", a->threads, "Runs of 'vary' at once (default: one per core; under mpirun, per rank: 1)")
      ->check(CLI::Range(1, 1024));
  run->add_option("--retries", a->retries, "Further attempts of a run of 'vary' whose work failed (default: 1)")
      ->check(CLI::Range(0, 100));
  run->add_flag("--quiet", a->quiet, "No progress, no summary");
  run->add_flag("--json", a->json, "Print summary.json instead of the table");
  run->add_flag("--list", a->list, "List the shipped scenarios");
  run->footer("Example:\n  tribotwin run irb6620_warmup -o runs/warmup --set duration_s=3600");
  run->callback([a, &code] { code = or_throw(execute(*a)); });
}

}  // namespace tribotwin::twin::program
