#include <tribotwin/render/commands/picture.hpp>
#include <tribotwin/render/pose/moment.hpp>

namespace tribotwin::render::program {
namespace {

struct Arguments : PictureOptions {
  std::size_t count = 6;
};

int execute(const Arguments& a) {
  a.check_output("a contact sheet", ".png");
  const Size size = a.pixels();
  const auto run = run_with_model(a.target);
  const PoseOptions options = run_options(a, *run);
  twin::Progress progress(a.quiet, "poses");
  auto painter = twin::or_throw(PosePainter::create(run->scenario->model, size));
  auto sheet = contact_sheet(painter, Moments(*run->model(), run->record).evenly(a.count), options,
                             [&](double share) { progress(share); });
  write(a.output, png(twin::or_throw(std::move(sheet))));
  return twin::done;
}

}  // namespace

void add_sheet(CLI::App& app, Call& call) {
  auto a = std::make_shared<Arguments>();
  auto* command = app.add_subcommand("sheet", "Poses over a run in one picture");
  a->add_to(*command, "Folder of a run", "640x480", "sheet.png");
  command->add_option("--count", a->count, "How many, evenly in time")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  command->footer(
      "Example:\n  tribotwin-report sheet runs/irb6620_warmup --count 9 -o sheet.png\n\nThe run is that of tribotwin "
      "run irb6620_warmup.");
  command->callback([a, &call] { call.code = execute(*a); });
}

}  // namespace tribotwin::render::program
