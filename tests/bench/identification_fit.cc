// Times identification::fit on columns of doubles (speed, load, temperature, friction), for identification.py.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <vector>

#include <tribotwin/twin/identification/curves/fit.hpp>

int main(int, char** argv) {
  using namespace tribotwin::twin::identification;
  std::ifstream in(argv[1], std::ios::binary | std::ios::ate);
  const auto count = static_cast<std::size_t>(in.tellg()) / sizeof(double) / 4;
  in.seekg(0);
  Samples s;
  for (auto* column : {&s.speed, &s.load, &s.temperature_degC, &s.friction}) {
    column->resize(count);
    in.read(reinterpret_cast<char*>(column->data()), static_cast<std::streamsize>(count * sizeof(double)));
  }
  // Everything a user gets: grid, minimum, sigmas, residuals, verdict.
  const auto& law = *tribotwin::friction::find_law("extended");
  double min_s = 1e300, cost = 0;
  for (int i = 0; i < 6; ++i) {  // as many as scipy has tries
    const auto begin = std::chrono::steady_clock::now();
    cost = fit(law, s)->cost;
    min_s = std::min(min_s, std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
  }
  std::printf("{\"seconds\": %.9g, \"cost\": %.17g}\n", min_s, cost);
}
