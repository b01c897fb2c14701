#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <set>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/experiments/sweep/sweep.hpp>
#include <tribotwin/twin/io/checksum.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/executor/ranks.hpp>

namespace tribotwin::twin::sweep {
namespace {

namespace fs = std::filesystem;

constexpr char folder[] = "runs", statistics_file[] = "statistics.json", origin_file[] = "origin.yaml";
constexpr std::size_t first_batch = 32;

std::string file_of(std::size_t run) { return fmt::format("{:07}.json", run); }

/// The runs before `end` that have a file, ascending: few of the many that a plan may ask for.
Result<std::vector<std::size_t>> runs_there(const fs::path& directory, std::size_t end) {
  const auto entries = entries_of(directory / folder);
  if (!entries) return tl::unexpected(entries.error());
  std::vector<std::size_t> there;
  for (const fs::directory_entry& entry : *entries) {
    const auto run = to_integer<std::size_t>(entry.path().stem().string());
    if (run && *run < end && entry.path().filename() == file_of(*run)) there.push_back(*run);
  }
  std::ranges::sort(there);
  return there;
}

/// The checks of the health check that warn: "saturation, tracking".
std::string warnings_of(const Summary& summary) {
  std::vector<std::string> checks;
  for (const HealthLine& line : health_lines(summary.health))
    if (line.verdict == Verdict::warning && std::ranges::find(checks, line.check) == checks.end())
      checks.push_back(line.check);
  return joined(checks);
}

RunResult failed(const Error& error) {
  return {.status = "failed",
          .message = error.message,
          .outputs = {},
          .bands = {},
          .another_attempt = error.kind == ErrorKind::work};
}

/// Whether the text is a run of this plan.
bool is_run(const Plan& plan, std::size_t run, const std::string& text) {
  const auto result = from_line(run, text);
  if (!result) return false;
  if (result->failed()) return true;
  return result->outputs.size() == plan.outputs.size() && result->bands.size() == plan.bands.size() &&
         std::ranges::all_of(result->bands, [&](const auto& band) { return band.size() == plan.band_times_s.size(); });
}

/// Whether what the plan asks to be kept of a finished run is there.
bool has_record(const Plan& plan, const fs::path& directory, std::size_t run, const std::string& text) {
  std::error_code error;
  return !plan.telemetry || from_line(run, text)->failed() ||
         fs::exists(record_of(directory, run) / "telemetry.h5", error);
}

/// `earlier`: of this call; what failed there is not tried again.
ResumableJobs jobs_of(const Plan& plan, const fs::path& directory, std::size_t count,
                      const std::vector<RunResult>& earlier, const std::atomic<bool>* stop) {
  ResumableJobs jobs{.folder = folder, .files = {}, .whole = {}, .make = {}};
  if (!plan.name.empty())
    jobs.origin = {origin_file,
                   fmt::format("plan: {}\ndescription: {}\n", quoted(plan.name), quoted(plan.description))};
  for (std::size_t r = 0; r < count; ++r) jobs.files.push_back(file_of(r));
  jobs.whole = [&plan, directory](std::size_t run, const std::string& text) {
    return is_run(plan, run, text) && has_record(plan, directory, run, text);
  };
  jobs.make = [&plan, &earlier, directory, stop](std::size_t run) -> Result<std::string> {
    if (run < earlier.size()) return tl::unexpected(Error(earlier[run].message));
    std::error_code ignored;
    if (plan.telemetry) fs::remove_all(record_of(directory, run), ignored);  // of an attempt that failed
    const auto made = make_run(plan, run, stop, plan.telemetry ? record_of(directory, run) : fs::path());
    if (!made) return tl::unexpected(made.error());
    if (made->another_attempt) return work_failed(made->message);
    return to_line(run, *made);
  };
  jobs.in_place_of = [](std::size_t run, const Error& error) { return to_line(run, failed(error)); };
  return jobs;
}

/// Why the sweep may end after these runs; empty: it may not.
std::string reason_to_stop(const Plan& plan, const std::vector<RunResult>& runs) {
  const std::size_t failing = failures(runs).failed;
  if (plan.failures && failing > *plan.failures)
    return fmt::format("{} of {} runs failed, more than {}", failing, runs.size(), *plan.failures);
  if (plan.narrower_than.empty()) return {};
  std::vector<std::string> reached;
  for (const auto& [output, width] : plan.narrower_than) {
    const auto interval = moments(sample_of(plan, runs, output), plan.outputs[output].range).mean.interval;
    if (!interval || !(interval->high - interval->low < width)) return {};
    reached.push_back(fmt::format("the 95 % interval of the mean of {} is {:.4g} wide, narrower than {:g}",
                                  plan.outputs[output].name, interval->high - interval->low, width));
  }
  return joined(reached, "; ");
}

/// Numbers of runs after which the stop rules are looked at; the last is all.
std::vector<std::size_t> batches(const Plan& plan) {
  if (!plan.failures && plan.narrower_than.empty()) return {plan.runs};
  const std::size_t block = plan.saltelli ? plan.saltelli->block() : 1;
  std::vector<std::size_t> ends;
  for (std::size_t end = 0; end < plan.runs;) {
    end += std::max(first_batch, end / 4);
    end = std::min(plan.runs, (end + block - 1) / block * block);
    ends.push_back(end);
  }
  return ends;
}

/// A file of results and what is to be in it.
struct ResultFile {
  std::string name;
  std::string bytes;
};

/// Results of a folder that this program wrote and nobody has changed: they follow the runs, of which one that had
/// failed may have been made since. The checksums are there before the first of the files: a kill between two of them
/// leaves none that the next call does not know.
class OwnResults {
 public:
  explicit OwnResults(const fs::path& directory) : directory_(directory) {
    std::ifstream lines(directory / file_name);
    for (std::string sum, name; lines >> sum >> name;) known_.insert({name, sum});
  }

  Result<void> write(const std::vector<ResultFile>& files, Existing existing) {
    std::set<std::string> own;
    std::set<std::pair<std::string, std::string>> sums;
    for (const auto& [name, bytes] : files) {
      const auto there = sum_of_file(directory_ / name);
      if (there && known_.contains({name, *there})) {
        own.insert(name);
        sums.insert({name, *there});
      }
      sums.insert({name, sum_of(bytes)});
    }
    std::string text;
    for (const auto& [name, sum] : sums) text += fmt::format("{} {}\n", sum, name);
    if (sums != known_)
      if (auto ok = write_file(directory_ / file_name, text, Existing::replace); !ok) return ok;
    for (const auto& [name, bytes] : files)
      if (auto ok = write_derived(directory_ / name, bytes, own.contains(name) ? Existing::replace : existing); !ok)
        return ok;
    return {};
  }

 private:
  static constexpr char file_name[] = "results.checksums";
  static std::string sum_of(const std::string& bytes) { return fmt::format("{:08x}", crc32(bytes)); }
  static std::optional<std::string> sum_of_file(const fs::path& file) {
    const auto bytes = read_bytes(file);  // one that cannot be read is not known
    return bytes ? std::optional(sum_of(*bytes)) : std::nullopt;
  }

  const fs::path directory_;
  std::set<std::pair<std::string, std::string>> known_;  ///< name and CRC-32 of what was written
};

Result<void> write_results(const Plan& plan, const LabOptions& options, SweepResult& out) {
  std::vector<ResultFile> files{{"results.csv", results_csv(plan, out.runs)}};
  const auto bands = bands_of(plan, out.runs);
  if (!bands.empty()) files.push_back({"bands.csv", bands_csv(plan, bands)});
  auto table = results_hdf5(plan, out.runs, bands);
  if (!table) return tl::unexpected(table.error());
  files.push_back({"results.h5", std::move(*table)});
  out.statistics = statistics_json(plan, out.runs, out.stopped);
  files.push_back({statistics_file, out.statistics});  // last: it says that the sweep is complete
  for (const auto& file : files) out.files.push_back(options.directory / file.name);
  return ranks().on_root([&] { return OwnResults(options.directory).write(files, options.existing); });
}

}  // namespace

fs::path record_of(const fs::path& directory, std::size_t run) {
  return directory / "telemetry" / fmt::format("{:07}", run);
}

Result<RunResult> make_run(const Plan& plan, std::size_t run, const std::atomic<bool>* stop,
                           const fs::path& directory) {
  if (stop && *stop) return work_failed("interrupted");
  const auto scenario = load_scenario(plan.scenario, plan.settings(run));
  if (!scenario) return failed(scenario.error());
  Collector collector(*scenario, plan.outputs, plan.bands, plan.band_times_s);
  RunOptions options{
      .directory = directory, .existing = Existing::replace, .stop = stop, .progress = {}, .sample = {}, .cycle = {}};
  collector.listen(options);
  const auto summary = twin::run(*scenario, options);
  if (!summary) return failed(summary.error());
  if (summary->interrupted) return work_failed("interrupted");
  const std::string warnings = warnings_of(*summary);
  return RunResult{.status = warnings.empty() ? "ok" : "warned",
                   .message = warnings,
                   .outputs = collector.outputs(*summary),
                   .bands = collector.bands()};
}

Result<SweepResult> run_sweep(const Plan& plan, const LabOptions& options, const std::atomic<bool>* stop) {
  const std::string identity = resolved_yaml(*plan.model, plan.resolved);
  SweepResult out;
  std::optional<std::size_t> present;
  std::shared_ptr<void> lock;
  for (const std::size_t end : batches(plan)) {
    lock.reset();
    LabOptions batch = options;
    batch.stop = stop;
    const double share_of_all = static_cast<double>(end) / static_cast<double>(plan.runs);
    if (options.progress)
      batch.progress = [&](double share, double left) { options.progress(share * share_of_all, left / share_of_all); };
    auto completed = complete(identity, jobs_of(plan, options.directory, end, out.runs, stop), batch);
    if (!completed) return tl::unexpected(completed.error());
    if (!present || completed->present > out.runs.size()) present = completed->present;
    lock = completed->lock;
    for (std::size_t r = out.runs.size(); r < end; ++r) out.runs.push_back(*from_line(r, completed->texts[r]));
    out.stopped = end < plan.runs ? reason_to_stop(plan, out.runs) : "";
    if (!out.stopped.empty()) break;
  }
  out.present = present.value_or(0);
  if (auto ok = write_results(plan, options, out); !ok) return tl::unexpected(ok.error());
  return out;
}

Result<std::vector<std::optional<RunResult>>> read_runs(const Plan& plan, const fs::path& directory) {
  std::vector<std::optional<RunResult>> all(plan.runs);
  const auto there = runs_there(directory, plan.runs);
  if (!there) return tl::unexpected(there.error());
  for (const std::size_t r : *there) {
    const auto text = read_text(directory / folder / file_of(r), "a file");
    if (!text) return tl::unexpected(text.error());
    if (is_run(plan, r, *text)) all[r] = from_line(r, *text);
  }
  return all;
}

Result<SweepStatus> read_status(const fs::path& directory) try {
  std::error_code error;
  const auto none = [&](const std::string& why) {
    return tl::unexpected(Error(fmt::format("{}: {}; give the folder of a sweep", directory.string(), why)));
  };
  if (!fs::is_regular_file(directory / "campaign.yaml", error)) return none("holds no sweep (no campaign.yaml)");
  Mapping plan((directory / "campaign.yaml").string(), "", load_yaml(directory / "campaign.yaml"));
  if (!plan.has("resolved_scenario") || !plan.has("runs")) return none("holds another kind of campaign");
  SweepStatus status{.planned = plan.whole("runs", {1, most_runs}), .seconds_left = {}};
  std::vector<fs::file_time_type> times;
  const auto there = runs_there(directory, status.planned);
  if (!there) return tl::unexpected(there.error());
  for (const std::size_t r : *there) {
    const fs::path file = directory / folder / file_of(r);
    const auto text = read_text(file, "a file");
    const auto result = text ? from_line(r, *text) : std::nullopt;
    if (!result) continue;
    ++status.present;
    status.failed += result->failed(), status.warned += result->status == "warned";
    if (const auto time = fs::last_write_time(file, error); !error) times.push_back(time);
  }
  status.finished = fs::exists(directory / statistics_file, error);
  std::ranges::sort(times);
  if (!status.finished && times.size() >= 2)
    status.seconds_left = std::chrono::duration<double>(times.back() - times.front()).count() /
                          static_cast<double>(times.size() - 1) * static_cast<double>(status.planned - status.present);
  return status;
} catch (const InputError& e) {
  return tl::unexpected(Error(e.what()));
}

}  // namespace tribotwin::twin::sweep
