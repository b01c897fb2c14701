#include <memory>

#include <fmt/format.h>

#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/experiments/fault_study/study.hpp>
#include <tribotwin/twin/experiments/friction/results.hpp>
#include <tribotwin/twin/experiments/working_days/results.hpp>
#include <tribotwin/twin/experiments/working_days/tables.hpp>
#include <tribotwin/twin/io/shipped.hpp>

namespace tribotwin::twin::program {
namespace {

struct Arguments {
  std::string campaign, directory;
  std::vector<std::string> settings;
  unsigned threads = 0;
  bool quiet = false, force = false;
};

/// Calls `run` with the folder, threads and progress that the user asked for.
auto with_progress(const Arguments& a, const std::string& work, const auto& run) {
  Progress progress(a.quiet, work);
  return run(LabOptions{.directory = a.directory,
                        .threads = a.threads,
                        .existing = replace_if(a.force),
                        .progress = [&](double share, double left) { progress(share, left); }});
}

/// Robots over working days.
Result<Exit> compare_days(const Arguments& a, const repeatability::Campaign& campaign) {
  const auto results = with_progress(a, fmt::format("{} tests", campaign.tests()), [&](const LabOptions& options) {
    return repeatability::run_campaign(campaign, options);
  });
  if (!results) return tl::unexpected(results.error());
  if (a.quiet) return done;
  print("{} tests, {} of them from earlier runs\n\n{}written:", campaign.tests(), results->present,
        repeatability::summary(campaign, results->days, results->findings));
  for (const auto& file : results->files) print(" {}", file.string());
  print("\n");
  return done;
}

Result<Exit> report(const Arguments& a, const Result<LabSummary>& summary, const Campaign& campaign,
                    const std::string& written) {
  if (!summary) return tl::unexpected(summary.error());
  if (a.quiet) return done;
  print("{} curves, {} of them from earlier runs, {} levels, {:.1f} s\n", summary->curves, summary->present,
        summary->levels, summary->wall_s);
  print("written: {}\n", written);
  if (summary->outside)
    note("{} of {} levels lie outside the range in which law '{}' was identified; its validity policy applies",
         summary->outside, summary->levels, campaign.model->drives()[campaign.drive].drive.law.info->name);
  return done;
}

Result<Exit> execute(const Arguments& a) {
  const std::filesystem::path file = given_or_shipped(a.campaign, ".yaml");
  const YAML::Node tree = or_wrong_input(campaign_tree(file, a.settings));
  if (repeatability::is_repeatability(tree))
    return compare_days(a, or_wrong_input(repeatability::load_campaign(file, tree)));
  if (study::is_study(tree)) {
    const study::Study study = or_wrong_input(study::load_study(file, tree));
    const Campaign& first = study.joints.front().campaign;
    const auto curves = fmt::format("{} curves", study.joints.size() * first.curves.size());
    return report(a,
                  with_progress(a, curves, [&](const LabOptions& options) { return study::run_study(study, options); }),
                  first, fmt::format("{0}/diagnosis.json, {0}/JOINT/curves.csv", a.directory));
  }
  const Campaign campaign = or_wrong_input(campaign_of(file, tree));
  return report(a,
                with_progress(a, fmt::format("{} curves", campaign.curves.size()),
                              [&](const LabOptions& options) { return run_campaign(campaign, options); }),
                campaign, fmt::format("{0}/curves.csv, {0}/campaign.yaml", a.directory));
}

}  // namespace

void add_lab(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* command = app.add_subcommand(
      "lab", "Measure friction curves over load and temperature in simulation, or compare robots over working days");
  command->add_option("CAMPAIGN", a->campaign, "Campaign file, or the name of a shipped one")->required();
  command
      ->add_option("-o,--output", a->directory,
                   "Folder for the results; continues a campaign that was interrupted there")
      ->required();
  command->add_option("--threads", a->threads, "Curves measured at once (default: one per core)")
      ->check(CLI::Range(1, 1024));
  command->add_option("--set", a->settings, "key=value with dotted keys; overrides the file")->allow_extra_args(false);
  command->add_flag("--quiet", a->quiet, "No progress, no summary");
  command->add_flag("--force", a->force, "Replace tables and parts that were changed since they were made");
  command->footer("Example:\n  tribotwin lab irb6620_load_campaign -o lab/load --set seed=7");
  command->callback([a, &code] { code = or_throw(execute(*a)); });
}

}  // namespace tribotwin::twin::program
