// The project's speed, as ratios within one run: A and B alternate, and the median of the pairwise ratios counts.
#include <algorithm>
#include <chrono>
#include <functional>
#include <random>

#include "robots.hpp"
#include <benchmark/benchmark.h>

#include <tribotwin/plugins/friction/batch.hpp>
#include <tribotwin/twin/simulation/run.hpp>

namespace {

using namespace tribotwin;

double seconds(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Median over pairs of time(a) / time(b).
void report_ratio(benchmark::State& state, const std::function<void()>& a, const std::function<void()>& b) {
  std::vector<double> ratios;
  a();
  b();
  for (auto _ : state) {
    const double ta = seconds(a), tb = seconds(b);
    ratios.push_back(ta / tb);
    state.SetIterationTime(ta + tb);
  }
  std::ranges::sort(ratios);
  state.counters["ratio"] = ratios[ratios.size() / 2];
  state.counters["low"] = ratios[ratios.size() / 10];
  state.counters["high"] = ratios[ratios.size() * 9 / 10];
}

/// Drives of the law `extended` with heat against the same robot in an engine without plugins.
void step(benchmark::State& state, bench::RobotOptions options) {
  const auto rivals = bench::rivals(options);
  bench::Swing swing(rivals);
  const int steps = 2000 / options.count;
  report_ratio(
      state, [&] { swing.step_ours(steps); }, [&] { swing.step_native(steps); });
}
BENCHMARK_CAPTURE(step, Euler, bench::RobotOptions{.integrator = "Euler"})->UseManualTime()->Iterations(60);
BENCHMARK_CAPTURE(step, Euler_damping, bench::RobotOptions{.integrator = "Euler", .damping = true})
    ->UseManualTime()
    ->Iterations(60);
BENCHMARK_CAPTURE(step, implicit, bench::RobotOptions{.integrator = "implicit"})->UseManualTime()->Iterations(60);
BENCHMARK_CAPTURE(step, implicit_damping, bench::RobotOptions{.integrator = "implicit", .damping = true})
    ->UseManualTime()
    ->Iterations(60);
BENCHMARK_CAPTURE(step, Euler_lugre, bench::RobotOptions{.integrator = "Euler", .lugre = true})
    ->UseManualTime()
    ->Iterations(60);
BENCHMARK_CAPTURE(step, implicit_lugre, bench::RobotOptions{.integrator = "implicit", .lugre = true})
    ->UseManualTime()
    ->Iterations(60);
BENCHMARK_CAPTURE(step, ten_robots, bench::RobotOptions{.count = 10})->UseManualTime()->Iterations(40);
BENCHMARK_CAPTURE(step, RK4, bench::RobotOptions{.integrator = "RK4"})->UseManualTime()->Iterations(30);
BENCHMARK_CAPTURE(step, RK4_damping, bench::RobotOptions{.integrator = "RK4", .damping = true})
    ->UseManualTime()
    ->Iterations(30);

/// A plain loop over std::exp and std::pow against the batch; the ratio is the speed-up.
void batch(benchmark::State& state, friction::VectorWidth width) {
  const auto law = *friction::published_law("extended");
  constexpr int n = 100000;
  std::mt19937_64 random(1);
  std::uniform_real_distribution<> v(0, 280), l(0, .73), T(38, 81);
  Eigen::ArrayXd vs(n), ls(n), Ts(n), out(n);
  for (int i = 0; i < n; ++i) vs[i] = v(random), ls[i] = l(random), Ts[i] = T(random);
  const auto& p = law.parameters;
  const auto plain = [&] {
    for (int i = 0; i < n; ++i)
      out[i] = p[0] + p[1] * ls[i] + p[4] * ls[i] * std::exp(-std::pow(vs[i] / p[7], p[8])) +
               (p[2] + p[3] * Ts[i]) * std::exp(-std::pow(vs[i] / (p[5] + p[6] * Ts[i]), p[8])) +
               (p[9] + p[10] * std::exp(-Ts[i] / p[11])) * vs[i];
    benchmark::DoNotOptimize(out.data());
  };
  if (width > friction::best_vector_width()) {
    state.SkipWithError("this machine lacks the vector width");
    return;
  }
  report_ratio(state, plain, [&] { benchmark::DoNotOptimize(friction::torque(law, vs, ls, Ts, width).data()); });
}
BENCHMARK_CAPTURE(batch, AVX2, friction::VectorWidth::avx2)->UseManualTime()->Iterations(40);
BENCHMARK_CAPTURE(batch, x86_64_baseline, friction::VectorWidth::baseline)->UseManualTime()->Iterations(40);

/// Simulated time / wall time of the warm-up on one core, telemetry included.
void warmup(benchmark::State& state, bool multirate) {
  const auto scenario = twin::load_scenario(TRIBOTWIN_SOURCE_DIR "/twin/scenarios/irb6620_warmup.yaml",
                                            {multirate ? "multirate.enabled=true" : "multirate.enabled=false",
                                             multirate ? "seed=1" : "duration_s=600"})
                            .value();
  const auto folder = std::filesystem::temp_directory_path() / "tribotwin_bench";
  double factor = 0;
  for (auto _ : state) {
    const auto s = twin::run(scenario, {.directory = folder});
    factor = std::max(factor, s->simulated_s / s->wall_s);
  }
  std::filesystem::remove_all(folder);
  state.counters["realtime_factor"] = factor;
}
BENCHMARK_CAPTURE(warmup, full, false)->Iterations(3)->Unit(benchmark::kSecond);
BENCHMARK_CAPTURE(warmup, multirate, true)->Iterations(3)->Unit(benchmark::kSecond);

}  // namespace

BENCHMARK_MAIN();
