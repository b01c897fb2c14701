#include <cstdio>

#include <tribotwin/plugins/friction/batch.hpp>
#include <tribotwin/twin/simulation/run.hpp>

int main(int argc, char** argv) {
  const auto law = tribotwin::friction::published_law("extended");
  std::printf("friction at 100 rad/s, load 0.3, 50 degC: %.6f\n", tribotwin::friction::torque(*law, 100, 0.3, 50));
  if (argc < 2) return 2;
  const auto scenario = tribotwin::twin::load_scenario(argv[1], {"duration_s=1", "multirate.enabled=false"}).value();
  const auto summary = tribotwin::twin::run(scenario, {});
  if (!summary) return 1;
  std::printf("simulated %g s\n", summary->simulated_s);
  return summary->simulated_s == 1 ? 0 : 1;
}
