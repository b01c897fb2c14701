#include <memory>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/twin/commands/program.hpp>
#include <tribotwin/twin/commands/robot.hpp>
#include <tribotwin/twin/experiments/fault_study/study.hpp>
#include <tribotwin/twin/experiments/friction/results.hpp>
#include <tribotwin/twin/experiments/working_days/results.hpp>
#include <tribotwin/twin/experiments/working_days/tables.hpp>
#include <tribotwin/twin/io/json.hpp>
#include <tribotwin/twin/io/shipped.hpp>
#include <tribotwin/twin/io/text.hpp>
#include <tribotwin/twin/numerics/executor/mpi.hpp>
#include <tribotwin/twin/robot/starting_points.hpp>

namespace tribotwin::twin::program {
namespace {

using Json = nlohmann::ordered_json;

struct Arguments {
  std::string campaign, directory;
  std::vector<std::string> settings;
  unsigned threads = 0;
  int retries = 1;
  bool json = false, quiet = false, force = false;
};

/// Calls `run` with the folder, threads and progress that the user asked for.
auto with_progress(const Arguments& a, const std::string& work, const auto& run) {
  Progress progress(a.quiet, work);
  return run(LabOptions{.directory = a.directory,
                        .threads = a.threads,
                        .existing = replace_if(a.force),
                        .progress = [&](double share, double left) { progress(share, left); },
                        .retries = a.retries});
}

/// What the health check found in the simulated days, those of the first test that has any, and how many have.
std::vector<std::string> warnings_of(const repeatability::Campaign& campaign,
                                     const std::vector<repeatability::WorkingDay>& days) {
  std::vector<std::string> sentences;
  std::size_t warned = 0;
  for (std::size_t test = 0; test < days.size(); ++test) {
    if (days[test].warnings.empty()) continue;
    if (warned++ > 0) continue;
    for (const auto& text : days[test].warnings)
      sentences.push_back(
          fmt::format("robot {}, day {}: {}", campaign.robot_of(test) + 1, campaign.day_of(test) + 1, text));
  }
  if (warned > 1) sentences.push_back(fmt::format("{} of {} tests have such warnings", warned, days.size()));
  return sentences;
}

/// Robots over working days.
Result<Exit> compare_days(const Arguments& a, const repeatability::Campaign& campaign) {
  const auto results = with_progress(a, fmt::format("{} tests", campaign.tests()), [&](const LabOptions& options) {
    return repeatability::run_campaign(campaign, options);
  });
  if (!results) return tl::unexpected(results.error());
  if (a.json) {
    Json json{{"tests", campaign.tests()}, {"present", results->present}};
    for (const auto& file : results->files) json["files"].push_back(file.string());
    json["warnings"] = warnings_of(campaign, results->days);
    return deliver(dump_json(json, 2) + "\n");
  }
  if (a.quiet) return done;
  print("{} tests, {} of them from earlier runs\n\n{}written:", campaign.tests(), results->present,
        repeatability::summary(campaign, results->days, results->findings));
  for (const auto& file : results->files) print(" {}", file.string());
  print("\n");
  for (const auto& text : warnings_of(campaign, results->days)) report_text(fmt::format("warning: {}\n", text));
  return done;
}

Result<Exit> report(const Arguments& a, const Result<LabSummary>& summary, const Campaign& campaign,
                    const std::vector<std::string>& written) {
  if (!summary) return tl::unexpected(summary.error());
  const auto& drive = campaign.model->drives()[campaign.drive];
  if (a.json)
    return deliver(dump_json(Json{{"curves", summary->curves},
                                  {"present", summary->present},
                                  {"levels", summary->levels},
                                  {"outside", summary->outside},
                                  {"saturated", summary->saturated},
                                  {"starting_points", !starting_point(*campaign.model, drive).empty()},
                                  {"wall_s", summary->wall_s},
                                  {"files", written}},
                             2) +
                   "\n");
  if (a.quiet) return done;
  print("{} curves, {} of them from earlier runs, {} levels, {:.1f} s\n", summary->curves, summary->present,
        summary->levels, summary->wall_s);
  print("written: {}\n", joined(written));
  if (summary->outside)
    note("{} of {} levels lie outside the range in which law '{}' was identified; its validity policy applies",
         summary->outside, summary->levels, drive.drive.law.info->name);
  note_starting_point(*campaign.model, drive);
  if (summary->saturated)
    report_text(fmt::format(
        "warning: {} of {} levels need more torque than the robot's drive can give ({:.4g} Nm): the bench has no such "
        "limit, a robot would not reach them; ask for less load, or raise ctrlrange to the torque of the real drive\n",
        summary->saturated, summary->levels, summary->torque_limit_nm));
  return done;
}

Result<Exit> execute(const Arguments& a) {
  if (const auto ok = join_ranks(); !ok) return tl::unexpected(ok.error());
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
                  first, {a.directory + "/diagnosis.json", a.directory + "/JOINT/curves.csv"});
  }
  const Campaign campaign = or_wrong_input(campaign_of(file, tree));
  return report(a,
                with_progress(a, fmt::format("{} curves", campaign.curves.size()),
                              [&](const LabOptions& options) { return run_campaign(campaign, options); }),
                campaign, {a.directory + "/curves.csv", a.directory + "/campaign.yaml"});
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
  command
      ->add_option("--threads", a->threads,
                   "Curves measured at once (default: one per core; under mpirun, per rank: 1)")
      ->check(CLI::Range(1, 1024));
  command->add_option("--retries", a->retries, "Further attempts of a curve or test whose work failed (default: 1)")
      ->check(CLI::Range(0, 100));
  command->add_option("--set", a->settings, "key=value with dotted keys; overrides the file")->allow_extra_args(false);
  command->add_flag("--json", a->json, "Print JSON instead of text");
  command->add_flag("--quiet", a->quiet, "No progress, no summary");
  command->add_flag("--force", a->force, "Replace tables and parts that were changed since they were made");
  command->footer("Example:\n  tribotwin lab irb6620_load_campaign -o lab/load --set seed=7");
  command->callback([a, &code] { code = or_throw(execute(*a)); });
}

}  // namespace tribotwin::twin::program
