// A twin of a whole robot in a loop of your own. Argument: a scenario file, such as
// twin/scenarios/irb6620_warmup.yaml.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include <tribotwin/twin/simulation/twin.hpp>

int main(int argc, char** argv) {
  using namespace tribotwin::twin;
  if (argc != 2) return std::fprintf(stderr, "usage: 03_twin_in_a_loop SCENARIO.yaml\n"), 2;

  auto scenario = load_scenario(argv[1], {"duration_s=20", "ambient_degC=30"});
  if (!scenario) return std::fprintf(stderr, "%s\n", scenario.error().message.c_str()), 2;

  Twin twin(std::move(*scenario));
  const std::size_t joint2 = 1;
  double friction_max_nm = 0;
  while (twin.step() == Status::running)
    friction_max_nm = std::max(friction_max_nm, std::abs(twin.drive(joint2).friction_nm));
  if (!twin.status()) return std::fprintf(stderr, "%s\n", twin.status().error().message.c_str()), 1;

  std::printf("%.0f s in %lld steps\n", twin.time_s(), static_cast<long long>(twin.steps()));
  std::printf("joint2: max. friction %.1f kNm, %.1f degC\n", 1e-3 * friction_max_nm, twin.temperature_degC(joint2));
}

// Prints:
// 20 s in 20000 steps
// joint2: max. friction 1.3 kNm, 30.2 degC
