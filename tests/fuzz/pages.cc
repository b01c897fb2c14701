// Readers of what other commands have written, as pages are made of it, for harness.cc.
#include <array>
#include <filesystem>
#include <string>
#include <string_view>

#include <tribotwin/render/report/record/run_data.hpp>
#include <tribotwin/render/report/run/run_summary.hpp>
#include <tribotwin/render/report/study_data.hpp>
#include <tribotwin/render/report/sweep/sweep_figures.hpp>
#include <tribotwin/tests/fuzz/reader.hpp>
#include <tribotwin/twin/experiments/sweep/stored.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/input.hpp>

namespace tribotwin::fuzz {
namespace {

namespace fs = std::filesystem;
using namespace tribotwin::twin;
using namespace tribotwin::render;

struct Seed {
  std::string_view reader, name;  ///< in the folder that is read; the last part also in corpus/READER
};

/// A folder of `seeds`, in which that of the chosen reader is `file`.
template <std::size_t n>
const Path& folder_with(const Path& file, std::string_view reader, const std::array<Seed, n>& seeds) {
  static const TemporaryFolder place("tribotwin-fuzz-pages");
  const std::string bytes = or_fail(read_bytes(file));
  for (const Seed& seed : seeds) {
    const Path to = place.path() / seed.name;
    fs::create_directories(to.parent_path());
    if (seed.reader == reader)
      or_fail(write_unforced(to, bytes));
    else
      fs::copy_file(Path(TRIBOTWIN_SOURCE_DIR) / "tests/fuzz/corpus" / seed.reader / to.filename(), to,
                    fs::copy_options::overwrite_existing);
  }
  return place.path();
}

constexpr std::array of_a_run{Seed{"summary", "summary.json"}};
constexpr std::array of_a_study{Seed{"study_json", "diagnosis.json"}, Seed{"study_curves", "joint1/curves.csv"}};
constexpr std::array of_a_sweep{Seed{"sweep_campaign", "campaign.yaml"}, Seed{"sweep_results", "results.csv"},
                                Seed{"sweep_bands", "bands.csv"}, Seed{"sweep_statistics", "statistics.json"}};

void read_summary(const Path& file) {
  const auto runs = load_runs(folder_with(file, "summary", of_a_run));
  if (!runs) return end(runs);
  for (const auto& run : *runs) {
    const auto joints = joint_summaries(*run);
    (void)most_warmed(*run, joints), (void)warmest(joints), (void)simulated_s(*run);
    (void)run->date(), (void)run->robot(), (void)run->serial_number();
  }
  ++read_whole;
}

void read_study(const Path& file, std::string_view reader) {
  end(load_study_folder(folder_with(file, reader, of_a_study)));
}

/// All figures of a sweep's page.
void draw(const SweepView& view) {
  for (std::size_t o = 0; o < view.outputs.size(); ++o) {
    (void)importance(view, o);
    if (!view.has_values(o)) continue;
    (void)distribution_of(view, o);
    const auto keys = view.leading(o);
    if (!keys.empty()) (void)over_factor(view, o, keys[0]);
    if (keys.size() > 1) (void)over_two(view, o, keys[0], keys[1]), (void)surface_over(view, o, keys[0], keys[1]);
  }
  for (std::size_t b = 0; b < view.sweep.bands.size(); ++b) (void)band_over_time(view, b);
}

void read_sweep_with(const Path& file, std::string_view reader) {
  const auto sweep = sweep::read_sweep(folder_with(file, reader, of_a_sweep));
  if (sweep) draw(SweepView(*sweep));
  end(sweep);
}

const std::array all{
    Reader{"summary", ".json", read_summary},
    Reader{"study_json", ".json", [](const Path& f) { read_study(f, "study_json"); }},
    Reader{"study_curves", ".csv", [](const Path& f) { read_study(f, "study_curves"); }},
    Reader{"sweep_campaign", ".yaml", [](const Path& f) { read_sweep_with(f, "sweep_campaign"); }},
    Reader{"sweep_results", ".csv", [](const Path& f) { read_sweep_with(f, "sweep_results"); }},
    Reader{"sweep_bands", ".csv", [](const Path& f) { read_sweep_with(f, "sweep_bands"); }},
    Reader{"sweep_statistics", ".json", [](const Path& f) { read_sweep_with(f, "sweep_statistics"); }},
};

}  // namespace

std::span<const Reader> readers() { return all; }

}  // namespace tribotwin::fuzz
