#include <fmt/format.h>

#include <tribotwin/render/commands/page.hpp>
#include <tribotwin/render/report/fleet/fleet_report.hpp>
#include <tribotwin/twin/diagnosis/fleet/database/database.hpp>
#include <tribotwin/twin/diagnosis/fleet/level_curve.hpp>

namespace tribotwin::render::program {
namespace {

struct Arguments : PageOptions {
  std::string store, date;
  FleetOptions fleet;
};

int execute(Arguments a, const std::string& command_line) {
  if (twin::diagnosis::fleet::is_url(a.store))
    throw twin::InputError(fmt::format("{}: a page is made of a store in a file, not in a database",
                                       twin::diagnosis::fleet::without_password(a.store)));
  if (!a.date.empty()) {
    a.fleet.survey.time_s = twin::to_time(a.date);
    if (!a.fleet.survey.time_s)
      throw twin::InputError(fmt::format("--date {}: write 2026-11-23 or 2026-11-23T08:17", a.date));
    if (a.date.size() == 10) *a.fleet.survey.time_s += 86399;  // the whole day
  }
  const PageFile page(a, std::filesystem::path(a.store).replace_extension(".html"), {a.store});
  const auto data = twin::or_wrong_input(load_fleet(a.store, a.fleet));
  return page.make(command_line, [&](const ReportOptions& options) { return make_fleet_report(data, options); });
}

}  // namespace

void add_fleet(CLI::App& app, Call& call) {
  auto a = std::make_shared<Arguments>();
  auto* command = app.add_subcommand("fleet",
                                     "The joints of a plant as a page: which need a look, how they changed over days, "
                                     "all robots at a glance");
  command->add_option("STORE", a->store, "Store of tribotwin fleet; it is not changed")->required();
  a->add_output_to(*command, "The page (default: STORE with the ending .html)");
  command
      ->add_option("--false-discovery-rate", a->fleet.survey.rate,
                   "Share of the listed joints that may be healthy, on average")
      ->check(CLI::Range(1e-6, 0.5))
      ->capture_default_str();
  command->add_option("--days", a->fleet.survey.days, "Length of the window that is judged [days]")
      ->check(CLI::Range(1e-3, 3650.0))
      ->capture_default_str();
  command->add_option("--date", a->date, "Last day that is judged (default: that of the newest curve)");
  command
      ->add_option("--load-sensitivity", a->fleet.survey.load_sensitivity,
                   "Relative rise of Fc and Fs per load_norm; that of the store's imports")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  command->add_option("--first", a->fleet.shown, "Number of listed joints that are shown with figures")
      ->check(CLI::Range(0, 100))
      ->capture_default_str();
  command->footer("Example:\n  tribotwin-report fleet plant.db -o week.html");
  command->callback([a, &call] { call.code = execute(*a, call.command_line); });
}

}  // namespace tribotwin::render::program
