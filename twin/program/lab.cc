#include <memory>

#include <fmt/format.h>

#include <tribotwin/twin/laboratory/results.hpp>
#include <tribotwin/twin/program/program.hpp>
#include <tribotwin/twin/repeatability/findings.hpp>
#include <tribotwin/twin/study/study.hpp>

namespace tribotwin::twin::program {
namespace {

struct Arguments {
  std::string campaign, directory;
  std::vector<std::string> settings;
  unsigned threads = 0;
  bool quiet = false;
};

/// Robots over working days.
int compare_days(const Arguments& a, const repeatability::Campaign& campaign) {
  const auto regressor = Regressor::create(campaign.model->get());
  if (!regressor) throw InputError(fmt::format("{}: {}", campaign.file.string(), regressor.error()));
  const auto excitation = excite(*campaign.model, *regressor, base_parameters(*regressor), campaign.excitation);
  if (!excitation) return complain(failed, excitation.error());
  if (campaign.duration_s < excitation->duration_s()) throw InputError(fmt::format("{}: duration_s: is {:g}, but one cycle of the motion takes {:.0f} s", campaign.file.string(), campaign.duration_s, excitation->duration_s()));
  Parts parts{.folder = "tests", .files = {},
              .whole = [](std::size_t, const std::string& text) { return repeatability::from_text(text).has_value(); },
              .make = [&](std::size_t test) { return repeatability::working_day(campaign, *excitation, test).map(repeatability::to_text); }};
  for (std::size_t test = 0; test < campaign.tests(); ++test) parts.files.push_back(repeatability::file_of(campaign, test).filename().string());
  const auto completed = [&] {
    Progress progress(a.quiet, fmt::format("{} tests", campaign.tests()));
    return complete(campaign.resolved_yaml, parts, {.directory = a.directory, .threads = a.threads, .progress = [&](double share, double left) { progress(share, left); }});
  }();
  if (!completed) return complain(failed, completed.error());
  std::vector<repeatability::WorkingDay> days;
  for (const auto& text : completed->texts) days.push_back(*repeatability::from_text(text));
  const auto findings = repeatability::find(campaign, days);
  if (!findings) return complain(failed, findings.error());
  const std::filesystem::path directory = a.directory;
  auto files = repeatability::tables(campaign, days, *findings);
  files.push_back({"motion.csv", to_csv(*excitation, *regressor, 250)});
  for (const auto& file : files)
    if (auto ok = write_file(directory / file.name, file.text); !ok) return complain(failed, ok.error());
  if (a.quiet) return done;
  fmt::print("{} tests, {} of them were there\n\n{}written:", campaign.tests(), completed->present, repeatability::summary(campaign, days, *findings));
  for (const auto& file : files) fmt::print(" {}", (directory / file.name).string());
  fmt::print("\n");
  return done;
}

int report(const Arguments& a, const tl::expected<LabSummary, std::string>& summary, const Campaign& campaign, const std::string& written) {
  if (!summary) return complain(failed, summary.error());
  if (a.quiet) return done;
  fmt::print("{} curves, {} of them were there, {} levels, {:.1f} s\n", summary->curves, summary->present, summary->levels, summary->wall_s);
  fmt::print("written: {}\n", written);
  if (summary->outside)
    fmt::print(stderr, "note: {} of {} levels lie outside the range in which law '{}' was identified; its validity policy applies\n", summary->outside, summary->levels,
               campaign.model->drives()[campaign.drive].drive.law.info->name);
  return done;
}

int execute(const Arguments& a) {
  const std::filesystem::path file = scenario_file(a.campaign);
  const YAML::Node tree = campaign_tree(file, a.settings);
  const auto ran = [&](auto run, const auto& work, std::size_t curves) {
    Progress progress(a.quiet, fmt::format("{} curves", curves));
    return run(work, LabOptions{.directory = a.directory, .threads = a.threads, .progress = [&](double share, double left) { progress(share, left); }});
  };
  if (repeatability::is_repeatability(tree)) return compare_days(a, repeatability::load_campaign(file, tree));
  if (study::is_study(tree)) {
    const study::Study study = study::load_study(file, tree);
    const Campaign& first = study.joints.front().campaign;
    return report(a, ran(study::run_study, study, study.joints.size() * first.curves.size()), first, fmt::format("{0}/diagnosis.json, {0}/JOINT/curves.csv", a.directory));
  }
  const Campaign campaign = campaign_of(file, tree);
  return report(a, ran(run_campaign, campaign, campaign.curves.size()), campaign, fmt::format("{0}/curves.csv, {0}/campaign.yaml", a.directory));
}

}  // namespace

void add_lab(CLI::App& app, int& code) {
  auto a = std::make_shared<Arguments>();
  auto* command = app.add_subcommand("lab", "Measure friction curves over load and temperature in simulation, or compare robots over working days");
  command->add_option("CAMPAIGN", a->campaign, "Campaign file, or the name of a shipped one")->required();
  command->add_option("-o,--output", a->directory, "Folder for the results; a run that was interrupted there goes on")->required();
  command->add_option("--threads", a->threads, "Curves measured at once (default: one per core)")->check(CLI::Range(1, 1024));
  command->add_option("--set", a->settings, "key=value, dotted keys, in place of what the file says")->allow_extra_args(false);
  command->add_flag("--quiet", a->quiet, "No progress, no summary");
  command->footer("Example:\n  tribotwin lab irb6620_load_campaign -o lab/load --set seed=7");
  command->callback([a, &code] { code = execute(*a); });
}

}  // namespace tribotwin::twin::program
