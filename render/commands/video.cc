#include <tribotwin/render/commands/picture.hpp>
#include <tribotwin/render/pose/video.hpp>

namespace tribotwin::render::program {
namespace {

struct Arguments : PictureOptions {
  double seconds = 20;
  int frames_per_s = 25;
};

int execute(const Arguments& a) {
  a.check_output("a film", ".mp4");
  const Size size = a.pixels();
  const auto run = run_with_model(a.target);
  const PoseOptions options = run_options(a, *run);
  {
    twin::Progress progress(a.quiet, "film");
    twin::or_throw(write_video(a.output.file, a.output.existing(), run->scenario->model, run->record, options,
                               {.size = size, .frames_per_s = a.frames_per_s, .length_s = a.seconds},
                               [&](double share) { progress(share); }));
  }
  print_files(a.output, {a.output.file});
  return twin::done;
}

}  // namespace

void add_video(CLI::App& app, Call& call) {
  auto a = std::make_shared<Arguments>();
  auto* command = app.add_subcommand("video", "A run as a film (needs ffmpeg)");
  a->add_to(*command, "Folder of a run", "960x720", "video.mp4");
  command->add_option("--seconds", a->seconds, "Length of the film [s]")
      ->check(CLI::Range(0.1, 3600.0))
      ->capture_default_str();
  command->add_option("--fps", a->frames_per_s, "Frames per second")->check(CLI::Range(1, 240))->capture_default_str();
  command->footer(
      "Example:\n  tribotwin-report video runs/irb6620_warmup --seconds 4 -o warmup.mp4\n\nThe run is that of "
      "tribotwin run irb6620_warmup.");
  command->callback([a, &call] { call.code = execute(*a); });
}

}  // namespace tribotwin::render::program
