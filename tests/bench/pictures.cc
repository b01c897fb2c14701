// Frames per second against MuJoCo's own sample `record` (package libmujoco-samples): same model, camera and size, both
// writing raw frames to a file, in turns. It needs a display: xvfb-run build/release/tests/pictures. Start-up is
// removed from both by the difference between many and few frames. Then the CPU time of the warm-up's report.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <vector>

#include <fmt/format.h>
#include <sys/resource.h>

#include <tribotwin/render/offscreen/renderer.hpp>
#include <tribotwin/render/process/child.hpp>
#include <tribotwin/twin/simulation/run.hpp>

namespace {

using namespace tribotwin;
namespace fs = std::filesystem;

double seconds(auto&& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

template <class T>
T must(Result<T> value) {
  if (value) return std::move(*value);
  fmt::print(stderr, "{}\n", value.error().message);
  std::exit(1);
}

/// Its output is not shown.
void run(const render::Program& program) {
  auto child = must(render::Child::start(program, render::Child::Stdout::answers));
  must(child.finish());
}

}  // namespace

int main() {  // long: both sides share the model, the size and the file
  const fs::path folder = fs::temp_directory_path() / fmt::format("tribotwin_pictures_{}", getpid());
  fs::create_directories(folder);
  constexpr render::Size size{1280, 960};
  constexpr int few = 5, many = 45;
  const auto model = must(mujoco::load_file(TRIBOTWIN_SOURCE_DIR "/mjcf/irb6620.xml"));
  const mujoco::ModelPtr m(mj_copyModel(nullptr, model->get()));
  m->vis.global.offwidth = size.width;
  m->vis.global.offheight = size.height;
  m->vis.quality.offsamples = 4;
  const std::string mjb = folder / "model.mjb", raw = folder / "frames.rgb";
  mj_saveModel(m.get(), mjb.c_str(), nullptr, 0);
  const auto theirs = [&](int frames) {
    // The sample ends with exit code 1 when it is done; what it wrote says whether it was.
    const double t = seconds([&] {
      run({{"sh", "-c", "mujoco-record \"$@\" || test $? = 1", "sh", mjb, fmt::format("{}", frames / 25.0), "25", raw},
           "libmujoco-samples"});
    });
    const auto written = fs::file_size(raw),
               wanted = static_cast<std::uintmax_t>(frames) * size.width * size.height * 3;
    if (written < wanted || written > wanted + wanted / static_cast<std::uintmax_t>(frames))
      fmt::print(stderr, "record wrote {} bytes instead of {}\n", written, wanted), std::exit(1);
    return t;
  };
  const auto ours = [&](int frames) {
    return seconds([&] {
      auto renderer = must(render::Renderer::create(m.get(), size, render::plain_quality));
      const mujoco::DataPtr d(mj_makeData(m.get()));
      std::FILE* file = std::fopen(raw.c_str(), "wb");
      for (int i = 0; i < frames; ++i) {
        render::pose_kinematics(m.get(), d.get());
        // record's camera: that of mjv_defaultCamera
        const auto image = must(renderer.draw(
            d.get(),
            {.azimuth_deg = 90, .elevation_deg = -45, .distance_m = 2, .look_at_m = std::array{0.0, 0.0, 0.0}}));
        std::fwrite(image.rgb.data(), 1, image.rgb.size(), file);
      }
      std::fclose(file);
    });
  };
  std::vector<double> ratios;
  for (int i = 0; i < 5; ++i) {
    const double record = theirs(many) - theirs(few), own = ours(many) - ours(few);
    ratios.push_back(record / own);
    fmt::print("{} x {}: record {:.2f}, ours {:.2f} frames per second, ratio {:.2f}\n", size.width, size.height,
               (many - few) / record, (many - few) / own, ratios.back());
    std::fflush(stdout);
  }
  std::ranges::sort(ratios);
  fmt::print("frames per second, ours / record: median ratio {:.2f}, {:.2f} to {:.2f}\n", ratios[2], ratios.front(),
             ratios.back());

  const fs::path folder_of_run = folder / "warmup";
  must(twin::run(twin::load_scenario(TRIBOTWIN_SOURCE_DIR "/twin/scenarios/irb6620_warmup.yaml").value(),
                 {.directory = folder_of_run}));
  const auto cpu = [] {
    rusage used{};
    getrusage(RUSAGE_CHILDREN, &used);
    return static_cast<double>(used.ru_utime.tv_sec + used.ru_stime.tv_sec) +
           1e-6 * static_cast<double>(used.ru_utime.tv_usec + used.ru_stime.tv_usec);
  };
  const double before = cpu();
  run({{TRIBOTWIN_REPORT, folder_of_run.string(), "--quiet"}, "tribotwin"});
  fmt::print("report of the warm-up: {:.1f} s of CPU\n", cpu() - before);
  fs::remove_all(folder);
  return 0;
}
