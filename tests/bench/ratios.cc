// The project's speed, as ratios within one run: A and B alternate, and the median of the pairwise ratios counts.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <functional>
#include <random>
#include <regex>

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

/// The IRB 6620, with bristles in every drive if asked.
std::shared_ptr<const mujoco::Model> robot(const char* integrator, bool lugre) {
  const std::filesystem::path folder = TRIBOTWIN_SOURCE_DIR "/mjcf";
  std::ifstream file(folder / "irb6620.xml");
  std::string text{std::istreambuf_iterator<char>(file), {}};
  if (lugre) {
    text = std::regex_replace(text, std::regex("actdim=\"3\""), "actdim=\"4\"");
    text = std::regex_replace(
        text, std::regex("<instance name=\"[^\"]*\">"),
        R"($& <config key="friction" value="lugre"/> <config key="sigma0" value="0.1"/> <config key="sigma1")"
        R"( value="0.002"/> <config key="vd" value="2"/>)");
  }
  return mujoco::load_string(text, {.integrator = integrator}, folder).value();
}

/// Six `extended` drives with heat against the same robot with frictionloss and, if asked, damping.
void step(benchmark::State& state, const char* integrator, bool damping, bool lugre = false) {
  const auto model = robot(integrator, lugre);
  mujoco::ModelPtr native(mj_copyModel(nullptr, model->get()));
  for (const auto& b : model->drives()) {
    native->dof_frictionloss[b.dof] = mujoco::friction_nm(b.drive, 0.5, 0.1, 50);
    if (damping) native->dof_damping[b.dof] = 20;
  }
  const mujoco::DataPtr ours = model->make_data(), theirs(mj_makeData(native.get()));
  // Both arms work around the same pose: gravity of the step before, and a swing of a fifth of the rated torque.
  const auto torque = [&](mjData* d, int i) {
    for (const auto& b : model->drives())
      d->ctrl[b.control] = d->qfrc_bias[b.dof] - 0.5 * b.drive.torque_max_nm * d->qpos[b.dof] +
                           0.2 * b.drive.torque_max_nm * std::sin(0.004 * i);
  };
  for (const auto& b : model->drives()) {
    drive::set_temperature(b.drive, mujoco::state(ours.get(), b), 50);
  }
  int i = 0, j = 0;
  report_ratio(
      state,
      [&] {
        for (int n = 0; n < 2000; ++n) {
          torque(ours.get(), i++);
          model->step(ours.get());
        }
      },
      [&] {
        for (int n = 0; n < 2000; ++n) {
          torque(theirs.get(), j++);
          mj_step(native.get(), theirs.get());
        }
      });
}
BENCHMARK_CAPTURE(step, Euler, "Euler", false)->UseManualTime()->Iterations(60);
BENCHMARK_CAPTURE(step, Euler_damping, "Euler", true)->UseManualTime()->Iterations(60);
BENCHMARK_CAPTURE(step, implicit, "implicit", false)->UseManualTime()->Iterations(60);
BENCHMARK_CAPTURE(step, implicit_damping, "implicit", true)->UseManualTime()->Iterations(60);
BENCHMARK_CAPTURE(step, Euler_lugre, "Euler", false, true)->UseManualTime()->Iterations(60);
BENCHMARK_CAPTURE(step, implicit_lugre, "implicit", false, true)->UseManualTime()->Iterations(60);
BENCHMARK_CAPTURE(step, RK4, "RK4", false)->UseManualTime()->Iterations(30);
BENCHMARK_CAPTURE(step, RK4_damping, "RK4", true)->UseManualTime()->Iterations(30);

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
