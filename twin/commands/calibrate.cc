#include <chrono>
#include <memory>

#include <fmt/format.h>

#include <tribotwin/twin/commands/calibrate/results.hpp>
#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/io/command_line/version.hpp>
#include <tribotwin/twin/io/folder_lock.hpp>
#include <tribotwin/twin/io/interrupt.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/numerics/executor/executor.hpp>
#include <tribotwin/twin/numerics/executor/journal.hpp>
#include <tribotwin/twin/numerics/executor/mpi.hpp>

namespace tribotwin::twin::program {
namespace {

namespace fs = std::filesystem;
using namespace identification;

struct Arguments {
  std::string fit, directory;
  std::optional<std::uint64_t> seed;
  TableArguments tables;
  unsigned threads = 0;
  int retries = 1;
  bool json = false, quiet = false, force = false;
};

/// Fits what is missing; every fit that is done goes to `file`, every simulation of the others to the journal.
Result<void> fit_missing(const Arguments& a, CalibrationResults& results, const fs::path& file, Journal* journal) {
  const auto save = [&](const SimulationFit& fit) -> Result<void> {
    results.fits.push_back(fit);
    if (auto ok = write_file(file, calibration_file(results), Existing::replace); !ok)
      return work_failed(ok.error().message);
    return {};
  };
  Progress progress(a.quiet, "calibrating");
  const auto started = std::chrono::steady_clock::now();
  const auto show = [&](double share) {
    const double wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
    progress(share, share > 0.01 ? wall_s * (1 / share - 1) : -1);
  };
  const auto outcome = calibrate(results.campaign.plan, results.fits,
                                 {.threads = threads_of(a.threads),
                                  .retries = a.retries,
                                  .folder = file.parent_path(),
                                  .identity = results.campaign.resolved,
                                  .journal = journal,
                                  .stop = &interrupted(),
                                  .progress = show,
                                  .done = save});
  if (!outcome) return tl::unexpected(outcome.error());
  return {};
}

/// What the same command goes on from; empty where nothing is there.
std::string kept_of(const CalibrationResults& results, const fs::path& file, const Journal& journal) {
  std::string kept;
  if (!results.fits.empty())
    kept = fmt::format("{} of {} fits are kept in {}", results.fits.size(), results.wanted(), file.string());
  if (!journal.empty())
    kept += fmt::format("{}simulations of unfinished fits are kept in {}", kept.empty() ? "" : ", and ",
                        journal.file().string());
  return kept;
}

Result<Exit> execute(const Arguments& a) {
  if (const auto ok = join_ranks(); !ok) return tl::unexpected(ok.error());
  const CalibrationCampaign campaign =
      read_calibration(given_or_shipped(a.fit, ".yaml"), a.seed, or_wrong_input(a.tables.options()));
  const fs::path directory = a.directory.empty() ? fs::path("runs") / campaign.file.stem() : fs::path(a.directory),
                 file = directory / "calibration.json";
  FolderLock lock;
  CalibrationResults results{campaign, {}};
  std::optional<Journal> journal;  // of rank 0
  const auto opened = ranks().on_root([&]() -> Result<void> {
    std::error_code error;
    fs::create_directories(directory, error);
    if (error) return work_failed(fmt::format("{}: cannot be created ({})", directory.string(), error.message()));
    if (auto ok = lock.take(directory); !ok) return work_failed(ok.error().message);
    results.fits = read_fits(campaign, file);
    auto there = Journal::open(directory / "calibration.unfinished",
                               campaign.resolved + version_text("tribotwin", mj_versionString()));
    if (!there) return tl::unexpected(there.error());
    journal = *std::move(there);
    return {};
  });
  if (!opened) return tl::unexpected(opened.error());
  if (!a.quiet && journal)
    if (const auto kept = kept_of(results, file, *journal); !kept.empty()) note("continues: {}", kept);

  catch_interrupts();
  if (auto ok = fit_missing(a, results, file, journal ? &*journal : nullptr); !ok) return tl::unexpected(ok.error());
  if (!ranks().root()) return done;  // rank 0 has the fits
  if (!results.complete()) {
    const auto kept = kept_of(results, file, *journal);
    return work_failed(kept.empty() ? "interrupted before the first simulation was done; nothing is written"
                                    : fmt::format("interrupted; {}; the same command continues there", kept));
  }
  journal->remove();
  for (std::size_t v = 0; v < campaign.plan.variants.size(); ++v)
    if (const auto ok = write_twin(results, *results.find(v, SimulationFit::all, 0), directory, replace_if(a.force));
        !ok)
      return work_failed(ok.error().message);
  if (!a.quiet)
    for (std::size_t v = 0; v < campaign.plan.variants.size(); ++v)
      for (const auto& text : or_throw(warnings_of(results, *results.find(v, SimulationFit::all, 0))))
        report_text(fmt::format("warning: {}\n", text));
  return deliver(a.json ? json_text(results) : table_of(results));
}

}  // namespace

void add_calibrate(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* c = app.add_subcommand(
      "calibrate", "Identify parameters of whole twins from recorded motions and test them on held-out recordings");
  c->add_option("FIT", a->fit,
                "FIT.yaml: free parameters and recordings (twin/README.md), or the name of a shipped one")
      ->required();
  c->add_option("-o,--output", a->directory, "Folder for calibration.json and the twins found (default: runs/NAME)");
  a->tables.add_to(*c);
  a->tables.add_gear_ratio_to(*c);
  c->add_option("--seed", a->seed, "Seed of the search");
  c->add_option("--threads", a->threads, "Threads (under mpirun, per rank: 1); they do not change the result")
      ->check(CLI::Range(1, 256));
  c->add_option("--retries", a->retries, "Further attempts of a simulation that crashed (default: 1)")
      ->check(CLI::Range(0, 100));
  c->add_flag("--json", a->json, "Print calibration.json instead of the table");
  c->add_flag("--quiet", a->quiet, "No progress, no notes");
  c->add_flag("--force", a->force, "Replace twin files that were changed since they were written");
  c->footer(
      "Example:\n  tribotwin calibrate xl330_fit -o runs/xl330_fit\n\nThis one needs the recordings that "
      "twin/scenarios/xl330_fit.yaml names; they do not ship.");
  c->callback([a, &code] { code = or_throw(execute(*a)); });
}

}  // namespace tribotwin::twin::program
