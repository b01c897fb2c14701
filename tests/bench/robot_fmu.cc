// A robot's FMU against the run of the program, both without a record: blocks of 1 s of simulated time alternate, and
// the median of the pairwise ratios of processor time counts.
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>

#include "../twin/portable/fmu_importer.hpp"

#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/portable/robot/robot_fmu.hpp>
#include <tribotwin/twin/simulation/run.hpp>

namespace {

namespace fs = std::filesystem;
using namespace tribotwin::twin;

constexpr int pairs = 41;

template <class Work>
double seconds(Work work) {
  const std::clock_t begin = std::clock();
  work();
  return static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
}

/// The FMU unpacked into a folder; its description.
Described unpack(const Scenario& scenario, const fs::path& folder) {
  std::string description;
  const auto files = robot_fmu_files(scenario, RobotCommands::scenario, "robot", FmiVersion::two, LIBRARY).value();
  for (const FmuFile& file : files) {
    fs::create_directories((folder / file.name).parent_path());
    std::ofstream(folder / file.name, std::ios::binary) << file.content;
    if (file.name == "modelDescription.xml") description = file.content;
  }
  return Described(description);
}

void step_to_the_end(Instance& instance, const std::vector<unsigned>& outputs, std::vector<double>& values) {
  if (instance.reset() != ok || instance.enter(0) != ok || instance.exit() != ok) std::abort();
  for (int k = 0; k < 100; ++k) {
    if (instance.step(0.01 * k, 0.01) != ok) std::abort();
    if (instance.get(outputs, values.data()) != ok) std::abort();
  }
}

}  // namespace

int main() {
  const Scenario scenario = load_scenario(fs::path(TRIBOTWIN_SOURCE_DIR) / "twin/scenarios/irb6620_warmup.yaml",
                                          {"duration_s=1", "multirate.enabled=false"})
                                .value();
  const TemporaryFolder folder("tribotwin-fmu-bench");
  const Described described = unpack(scenario, folder.path());
  const Library library(folder.path() / fmu_library_name("robot", FmiVersion::two));
  const auto instance =
      instantiate(library, FmiVersion::two, described.token, "file://" + (folder.path() / "resources").string());
  std::vector<unsigned> outputs;
  for (const auto& [name, reference] : described.references)
    if (name != "outside") outputs.push_back(reference);
  std::vector<double> values(outputs.size()), ratios;
  for (int i = 0; i < pairs; ++i) {
    const double by_program = seconds([&] { (void)run(scenario, {}).value(); });
    ratios.push_back(seconds([&] { step_to_the_end(*instance, outputs, values); }) / by_program);
  }
  std::ranges::sort(ratios);
  std::printf("1 s of a robot by its FMU: %.3f x the run of the program (quartiles %.3f and %.3f); bar 1.1\n",
              ratios[pairs / 2], ratios[pairs / 4], ratios[3 * pairs / 4]);
}
