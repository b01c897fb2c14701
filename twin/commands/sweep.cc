#include <chrono>
#include <cmath>
#include <memory>
#include <optional>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/experiments/sweep/sweep.hpp>
#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/executor/executor.hpp>
#include <tribotwin/twin/numerics/executor/mpi.hpp>
#include <tribotwin/twin/numerics/executor/ranks.hpp>

namespace tribotwin::twin::program {
namespace {

using Json = nlohmann::ordered_json;

struct Arguments {
  std::string plan, directory;
  unsigned threads = 0;
  std::optional<std::int64_t> run;
  bool dry_run = false, status = false, json = false, quiet = false, force = false;
};

std::string seconds(double s) {
  if (s < 100) return fmt::format("{:.3g} s", s);
  return s < 6000 ? fmt::format("{:.3g} min", s / 60) : fmt::format("{:.3g} h", s / 3600);
}

Result<Exit> show_status(const Arguments& a) {
  const auto status = or_throw(sweep::read_status(a.directory));
  if (a.json)
    return deliver(Json{{"planned", status.planned},
                        {"present", status.present},
                        {"failed", status.failed},
                        {"warned", status.warned},
                        {"finished", status.finished},
                        {"seconds_left", status.seconds_left ? Json(*status.seconds_left) : Json(nullptr)}}
                       .dump(2) +
                   "\n");
  print("{} of {} runs, {} failed, {} warned by the health check; {}\n", status.present, status.planned, status.failed,
        status.warned,
        status.finished       ? "the results are written"
        : status.seconds_left ? fmt::format("about {} left at the pace so far", seconds(*status.seconds_left))
                              : "the results are not written yet");
  return done;
}

/// Makes one run to time it, and writes nothing.
Result<Exit> foretell(const Arguments& a, const sweep::Plan& plan) {
  const auto start = std::chrono::steady_clock::now();
  const auto made = or_throw(sweep::make_run(plan, 0, &interrupted()));
  const double one_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const unsigned threads = threads_of(a.threads);
  const double rounds = std::ceil(static_cast<double>(plan.runs) / threads);
  if (a.json)
    return deliver(Json{{"runs", plan.runs},
                        {"threads", threads},
                        {"seconds_of_one", one_s},
                        {"seconds", one_s * rounds},
                        {"status", made.status},
                        {"message", made.message}}
                       .dump(2) +
                   "\n");
  print("{} runs; run 0 took {} and is {}{}{}; on {} threads the sweep takes about {}\n", plan.runs, seconds(one_s),
        made.status, made.message.empty() ? "" : ": ", made.message, threads, seconds(one_s * rounds));
  for (std::size_t o = 0; o < made.outputs.size(); ++o) print("{} = {}\n", plan.outputs[o].name, made.outputs[o]);
  if (made.failed()) return work_failed("run 0 failed: " + made.message);
  return done;
}

/// One run of the sweep with all its files.
Result<Exit> repeat(const Arguments& a, const sweep::Plan& plan) {
  const auto number = static_cast<std::size_t>(*a.run);
  if (number >= plan.runs)
    throw InputError(fmt::format("--run {}: the plan has the runs 0 .. {}", *a.run, plan.runs - 1));
  if (std::error_code error; std::filesystem::exists(std::filesystem::path(a.directory) / "campaign.yaml", error))
    throw InputError(fmt::format("-o {}: holds a sweep; choose another folder for the run", a.directory));
  const auto scenario = or_throw(load_scenario(plan.scenario, plan.settings(number)));
  const auto summary = [&] {
    Progress progress(a.quiet);
    return or_throw(twin::run(scenario, {.directory = a.directory,
                                         .existing = replace_if(a.force),
                                         .stop = &interrupted(),
                                         .progress = [&](double share, double left) { progress(share, left); },
                                         .sample = {},
                                         .cycle = {}}));
  }();
  if (a.json) return deliver(summary_json(summary));
  if (!a.quiet) print("written: {0}/telemetry.h5, {0}/summary.json, {0}/scenario.yaml\n", a.directory);
  if (summary.interrupted) return work_failed(fmt::format("interrupted at {:.6g} s", summary.simulated_s));
  return done;
}

std::string interval_text(const nlohmann::json& estimate) {
  const auto& interval = estimate["confidence_95"];
  if (!interval.is_array() || interval[0].is_null()) return "";
  return fmt::format("{:.5g} .. {:.5g}", interval[0].get<double>(), interval[1].get<double>());
}

/// The group or key with the largest share or correlation.
std::string strongest(const nlohmann::json& output) {
  const bool shares = output.contains("sobol_indices") && !output["sobol_indices"].empty();
  std::string name;
  double largest = -1, value = 0;
  const nlohmann::json all = output[shares ? "sobol_indices" : "rank_correlations"];
  for (const auto& [key, one] : all.items()) {
    if (one.is_null()) continue;
    const auto& number = shares ? one["total"]["value"] : one["value"];
    if (!number.is_number() || std::abs(number.get<double>()) <= largest) continue;
    value = number.get<double>(), largest = std::abs(value), name = key;
  }
  if (name.empty()) return "";
  return fmt::format("{} ({} {:.2f})", name, shares ? "total index" : "rank correlation", value);
}

std::string table_of(const std::string& statistics) {
  const auto all = parse_json(statistics);
  TextTable table{{TextTable::left("output"), TextTable::right("mean"), TextTable::left("95 %"), TextTable::right("sd"),
                   TextTable::right("min"), TextTable::right("max"), TextTable::left("varies most with")}};
  for (const auto& [name, o] : all["outputs"].items()) {
    const auto number = [&](const nlohmann::json& x) {
      return x.is_number() ? fmt::format("{:.5g}", x.get<double>()) : "";
    };
    if (!o.contains("mean")) {
      table.add({name, "-", "no run has it", "", "", "", ""});
      continue;
    }
    table.add({name, number(o["mean"]["value"]), interval_text(o["mean"]),
               o.contains("deviation") ? number(o["deviation"]["value"]) : "", number(o["min"]), number(o["max"]),
               strongest(o)});
  }
  return table.text();
}

void report(const Arguments& a, const sweep::Plan& plan, const sweep::SweepResult& result) {
  const auto failing = sweep::failures(result.runs);
  print("{} runs, {} of them from earlier calls, {} failed, {} warned by the health check\n", result.runs.size(),
        result.present, failing.failed, failing.warned);
  print_text(table_of(result.statistics));
  print("written:");
  for (const auto& file : result.files) print(" {}", file.string());
  print("\n");
  if (!result.stopped.empty()) note("stopped after {} of {} runs: {}", result.runs.size(), plan.runs, result.stopped);
  for (const auto& text : parse_json(result.statistics)["notes"]) note("{}", text.get<std::string>());
  if (failing.warned)
    report_text(
        fmt::format("warning: {} runs are not what the scenario asks for; see column message of {}/results.csv\n",
                    failing.warned, a.directory));
}

Json json_of(const sweep::SweepResult& result) {
  Json json = Json::parse(result.statistics);
  json["present"] = result.present;
  json["files"] = Json::array();
  for (const auto& file : result.files) json["files"].push_back(file.string());
  return json;
}

Result<Exit> execute(const Arguments& a) {
  if (const auto ok = join_ranks(); !ok) return tl::unexpected(ok.error());
  if (a.directory.empty() && !a.dry_run)
    throw InputError("-o: is missing: the folder for the results (or use --dry-run)");
  const bool divided = !a.status && !a.dry_run && !a.run;
  if (!divided && !ranks().root()) return done;
  if (a.status) return show_status(a);
  if (a.plan.empty()) throw InputError("sweep needs a plan, for example irb6620_sweep");
  catch_interrupts();
  const sweep::Plan plan = or_throw(sweep::load_plan(given_or_shipped(a.plan, ".yaml")));
  if (a.dry_run) return foretell(a, plan);
  if (a.run) return repeat(a, plan);
  const auto result = [&] {
    Progress progress(a.quiet, fmt::format("{} runs", plan.runs));
    return sweep::run_sweep(plan,
                            {.directory = a.directory,
                             .threads = a.threads,
                             .existing = replace_if(a.force),
                             .progress = [&](double share, double left) { progress(share, left); }},
                            &interrupted());
  }();
  if (!result && interrupted())
    return work_failed(
        fmt::format("interrupted; the runs so far are kept in {}, and the same command goes on", a.directory));
  if (!result) return tl::unexpected(result.error());
  if (a.json)
    print_text(json_of(*result).dump(2) + "\n");
  else if (!a.quiet)
    report(a, plan, *result);
  const auto failing = sweep::failures(result->runs);
  if (failing.first)
    return work_failed(fmt::format("{} of {} runs failed, the first is run {}: {}", failing.failed, result->runs.size(),
                                   *failing.first, result->runs[*failing.first].message));
  return done;
}

}  // namespace

void add_sweep(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* command = app.add_subcommand(
      "sweep", "Run a scenario many times over factors or identified parameters: statistics, sensitivities, bands");
  command->add_option("PLAN", a->plan, "Plan file, or the name of a shipped one");
  command->add_option("-o,--output", a->directory,
                      "Folder for the results; continues a sweep that was interrupted there");
  command->add_option("--threads", a->threads, "Runs at once (default: one per core; under mpirun, per rank: 1)")
      ->check(CLI::Range(1, 1024));
  auto* dry_run = command->add_flag("--dry-run", a->dry_run, "Make one run, say how long all take, write nothing");
  auto* status = command->add_flag("--status", a->status, "Say how far the sweep in the folder of -o is; reads only");
  command->add_option("--run", a->run, "Make run N of the plan alone, with telemetry, as 'tribotwin run' does")
      ->check(CLI::Range(0, 10000000))
      ->excludes(dry_run)
      ->excludes(status);
  dry_run->excludes(status);
  command->add_flag("--json", a->json, "Print JSON instead of text");
  command->add_flag("--quiet", a->quiet, "No progress, no summary");
  command->add_flag("--force", a->force, "Replace results that were changed since they were made");
  command->footer("Example:\n  tribotwin sweep irb6620_sweep -o sweeps/irb6620");
  command->callback([a, &code] { code = or_throw(execute(*a)); });
}

}  // namespace tribotwin::twin::program
