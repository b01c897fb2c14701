#include <tribotwin/render/commands/page.hpp>
#include <tribotwin/render/report/study_report.hpp>

namespace tribotwin::render::program {
namespace {

int execute(const FolderOptions& a, const std::string& command_line) {
  const auto joints = twin::or_wrong_input(load_study_folder(a.directory));
  const PageFile page(a, "diagnosis.json");
  return page.make(command_line,
                   [&](const ReportOptions& options) { return make_study_report(a.directory, joints, options); });
}

}  // namespace

void add_study(CLI::App& app, Call& call) {
  auto a = std::make_shared<FolderOptions>();
  auto* command = app.add_subcommand("study",
                                     "The study of Zhou 2024 as a page: friction cold to hot and under load, features, "
                                     "regions, distances, faults, ROC curves");
  a->add_to(*command, "Folder of tribotwin lab for a study of joints");
  command->footer("Example:\n  tribotwin-report study lab/diagnosis -o study.html");
  command->callback([a, &call] { call.code = execute(*a, call.command_line); });
}

}  // namespace tribotwin::render::program
