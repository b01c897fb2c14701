#include <memory>

#include <fmt/format.h>

#include <tribotwin/twin/laboratory/results.hpp>
#include <tribotwin/twin/program/program.hpp>
#include <tribotwin/twin/study/study.hpp>

namespace tribotwin::twin::program {
namespace {

struct Arguments {
  std::string campaign, directory;
  std::vector<std::string> settings;
  unsigned threads = 0;
  bool quiet = false;
};

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
  auto* command = app.add_subcommand("lab", "Measure friction curves over load and temperature in simulation: curves.csv");
  command->add_option("CAMPAIGN", a->campaign, "Campaign file, or the name of a shipped one")->required();
  command->add_option("-o,--output", a->directory, "Folder for the results; a run that was interrupted there goes on")->required();
  command->add_option("--threads", a->threads, "Curves measured at once (default: one per core)")->check(CLI::Range(1, 1024));
  command->add_option("--set", a->settings, "key=value, dotted keys, in place of what the file says")->allow_extra_args(false);
  command->add_flag("--quiet", a->quiet, "No progress, no summary");
  command->footer("Example:\n  tribotwin lab irb6620_load_campaign -o lab/load --set seed=7");
  command->callback([a, &code] { code = execute(*a); });
}

}  // namespace tribotwin::twin::program
