#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <sys/resource.h>

#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/experiments/sweep/batch_job.hpp>
#include <tribotwin/twin/experiments/sweep/sweep.hpp>
#include <tribotwin/twin/io/file.hpp>
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
  int retries = 1;
  std::optional<std::int64_t> run, ranks;
  bool dry_run = false, slurm = false, status = false, json = false, quiet = false, force = false;
};

std::string seconds(double s) {
  if (s < 100) return fmt::format("{:.3g} s", s);
  return s < 6000 ? fmt::format("{:.3g} min", s / 60) : fmt::format("{:.3g} h", s / 3600);
}

Result<Exit> show_status(const Arguments& a) {
  const auto status = or_throw(sweep::read_status(a.directory));
  if (a.json)
    return deliver(dump_json(Json{{"planned", status.planned},
                                  {"present", status.present},
                                  {"failed", status.failed},
                                  {"warned", status.warned},
                                  {"finished", status.finished},
                                  {"seconds_left", status.seconds_left ? Json(*status.seconds_left) : Json(nullptr)}},
                             2) +
                   "\n");
  print("{} of {} runs, {} failed, {} warned by the health check; {}\n", status.present, status.planned, status.failed,
        status.warned,
        status.finished       ? "the results are written"
        : status.seconds_left ? fmt::format("about {} left at the pace so far", seconds(*status.seconds_left))
                              : "the results are not written yet");
  return done;
}

struct Sample {
  sweep::RunResult made;
  double one_s = 0, memory_MB = 0;  ///< memory: the largest that this process had
  double record_MB = 0;             ///< on disk, of a plan with telemetry
};

/// Run 0, to time it; keeps nothing.
Sample sample_of(const sweep::Plan& plan) {
  namespace fs = std::filesystem;
  std::optional<TemporaryFolder> telemetry;
  if (plan.telemetry && telemetry.emplace("tribotwin-sweep").path().empty())
    throw std::runtime_error("a temporary folder for the telemetry cannot be created");
  const auto start = std::chrono::steady_clock::now();
  const auto made = sweep::make_run(plan, 0, &interrupted(), telemetry ? telemetry->path() : fs::path());
  const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - start;
  Sample sample{.one_s = spent.count()};
  if (telemetry)
    for (const fs::directory_entry& file : or_fail(entries_of(telemetry->path())))
      sample.record_MB += static_cast<double>(file.file_size()) / 1e6;
  sample.made = or_throw(made);
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  sample.memory_MB = static_cast<double>(usage.ru_maxrss) / 1024;
  return sample;
}

Result<void> worked(const Sample& sample) {
  if (sample.made.failed()) return work_failed("run 0 failed: " + sample.made.message);
  return {};
}

Result<Exit> foretell(const Arguments& a, const sweep::Plan& plan) {
  const int asked = static_cast<int>(a.ranks.value_or(ranks().size()));
  const unsigned several = static_cast<unsigned>(asked), threads = threads_of(a.threads, asked);
  const Sample sample = sample_of(plan);
  const double all_s = sweep::predicted_s(plan.runs, sample.one_s, several * threads);
  if (a.json)
    return deliver(dump_json(Json{{"runs", plan.runs},
                                  {"ranks", several},
                                  {"threads", threads},
                                  {"seconds_of_one", sample.one_s},
                                  {"seconds", all_s},
                                  {"memory_MB", sample.memory_MB},
                                  {"telemetry_MB", sample.record_MB * static_cast<double>(plan.runs)},
                                  {"status", sample.made.status},
                                  {"message", sample.made.message}},
                             2) +
                   "\n");
  print("{} run{}; run 0 took {} and {:.0f} MB and is {}{}{}; on {}{} thread{} the sweep takes about {}\n", plan.runs,
        plan.runs == 1 ? "" : "s", seconds(sample.one_s), sample.memory_MB, sample.made.status,
        sample.made.message.empty() ? "" : ": ", sample.made.message,
        several > 1 ? fmt::format("{} ranks of ", several) : "", threads, threads == 1 ? "" : "s", seconds(all_s));
  if (plan.telemetry) print("telemetry of all runs: {:.3g} MB\n", sample.record_MB * static_cast<double>(plan.runs));
  TextTable table{{TextTable::left("output"), TextTable::right("run 0")}};
  for (std::size_t o = 0; o < sample.made.outputs.size(); ++o)
    table.add({plan.outputs[o].name,
               std::isfinite(sample.made.outputs[o]) ? fmt::format("{:.5g}", sample.made.outputs[o]) : "-"});
  if (!sample.made.outputs.empty()) print_text(table.text());
  if (auto ok = worked(sample); !ok) return tl::unexpected(ok.error());
  return done;
}

/// The file for sbatch, and how long its job takes.
Result<Exit> write_job(const Arguments& a, const sweep::Plan& plan) {
  namespace fs = std::filesystem;
  fs::path directory = fs::absolute(a.directory).lexically_normal();
  if (!directory.has_filename()) directory = directory.parent_path();
  if (!directory.has_filename()) throw InputError(fmt::format("-o {}: is not the name of a new folder", a.directory));
  sweep::BatchJob job{.program = fs::read_symlink("/proc/self/exe"),
                      .plan = fs::absolute(plan.file).lexically_normal(),
                      .directory = directory,
                      .runs = plan.runs,
                      .threads = std::max(a.threads, 1U),
                      .retries = a.retries};
  const fs::path file = sweep::batch_file(job);
  std::error_code error;
  fs::create_directories(file.parent_path(), error);  // as a sweep does; what is wrong with it says check_output
  or_wrong_input(check_output(file, replace_if(a.force), std::vector{job.plan, plan.scenario}));
  or_throw(sweep::sbatch(job));  // names that it cannot hold, before the run
  const Sample sample = sample_of(plan);
  if (auto ok = worked(sample); !ok) return tl::unexpected(ok.error());
  job.one_s = sample.one_s, job.memory_MB = sample.memory_MB;
  job.ranks = a.ranks ? static_cast<unsigned>(*a.ranks) : sweep::suitable_ranks(plan.runs, job.one_s, job.threads);
  if (auto ok = write_file(file, or_throw(sweep::sbatch(job)), replace_if(a.force)); !ok)
    return tl::unexpected(ok.error());
  const double all_s = sweep::predicted_s(plan.runs, job.one_s, job.ranks * job.threads);
  if (a.json)
    return deliver(dump_json(Json{{"file", file.string()},
                                  {"runs", plan.runs},
                                  {"ranks", job.ranks},
                                  {"threads", job.threads},
                                  {"seconds_of_one", job.one_s},
                                  {"seconds", all_s},
                                  {"memory_MB", job.memory_MB}},
                             2) +
                   "\n");
  if (!a.quiet)
    print("written: {0} ({1} runs on {2} rank{3} of {4} thread{5}: about {6}); submit it with: sbatch {0}\n",
          file.string(), plan.runs, job.ranks, job.ranks == 1 ? "" : "s", job.threads, job.threads == 1 ? "" : "s",
          seconds(all_s));
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
  if (a.ranks && !a.dry_run && !a.slurm)
    throw InputError("--ranks: is for --dry-run and --slurm; mpirun -n N starts a sweep on N ranks");
  const bool divided = !a.status && !a.dry_run && !a.slurm && !a.run;
  if (!divided && !ranks().root()) return done;
  if (a.status) return show_status(a);
  if (a.plan.empty()) throw InputError("sweep needs a plan, for example irb6620_sweep");
  catch_interrupts();
  const sweep::Plan plan = or_throw(sweep::load_plan(given_or_shipped(a.plan, ".yaml")));
  if (a.dry_run) return foretell(a, plan);
  if (a.slurm) return write_job(a, plan);
  if (a.run) return repeat(a, plan);
  const auto result = [&] {
    Progress progress(a.quiet, fmt::format("{} runs", plan.runs));
    return sweep::run_sweep(plan,
                            {.directory = a.directory,
                             .threads = a.threads,
                             .existing = replace_if(a.force),
                             .progress = [&](double share, double left) { progress(share, left); },
                             .retries = a.retries},
                            &interrupted());
  }();
  if (!result && interrupted())
    return work_failed(
        fmt::format("interrupted; the runs so far are kept in {}, and the same command goes on", a.directory));
  if (!result) return tl::unexpected(result.error());
  if (a.json)
    print_text(dump_json(json_of(*result), 2) + "\n");
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
  command
      ->add_option("--retries", a->retries,
                   "Further attempts of a run that fails, but not because of its input (default: 1)")
      ->check(CLI::Range(0, 100));
  auto* dry_run = command->add_flag("--dry-run", a->dry_run, "Make one run, say how long all take, write nothing");
  auto* slurm = command->add_flag(
      "--slurm", a->slurm, "Write DIR.sbatch, a job of Slurm that makes the sweep and goes on when it is stopped");
  command->add_option("--ranks", a->ranks, "MPI ranks to foretell for, or of the job (default: about 15 min of work)")
      ->check(CLI::Range(1, 100000));
  auto* status = command->add_flag("--status", a->status, "Say how far the sweep in the folder of -o is; reads only");
  command->add_option("--run", a->run, "Make run N of the plan alone, with telemetry, as 'tribotwin run' does")
      ->check(CLI::Range(0, 10000000))
      ->excludes(dry_run)
      ->excludes(slurm)
      ->excludes(status);
  dry_run->excludes(status)->excludes(slurm);
  slurm->excludes(status);
  command->add_flag("--json", a->json, "Print JSON instead of text");
  command->add_flag("--quiet", a->quiet, "No progress, no summary");
  command->add_flag("--force", a->force, "Replace results that were changed since they were made");
  command->footer(
      "Example:\n  tribotwin sweep irb6620_sweep -o sweeps/irb6620\n  tribotwin sweep irb6620_sweep -o sweeps/cluster "
      "--slurm --ranks 4");
  command->callback([a, &code] { code = or_throw(execute(*a)); });
}

}  // namespace tribotwin::twin::program
