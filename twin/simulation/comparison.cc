#include <algorithm>
#include <cmath>

#include <tribotwin/twin/simulation/comparison.hpp>

namespace tribotwin::twin {

void RecordingComparison::add(const Twin& twin) {
  if (!scenario_.recording || !scenario_.baseline) return;
  const SetPoints& r = *scenario_.recording;
  const int address = position_address(twin.model().get(), twin.model().drives()[0]);
  for (; next_ < r.time_s.size() && r.time_s[next_] - r.time_s[0] <= twin.time_s() + 1e-12; ++next_) {
    if (!std::isfinite(r.measured_rad[0][next_])) continue;
    error_sum_rad_ += std::abs(twin.data()->qpos[address] - r.measured_rad[0][next_]);
    ++samples_;
  }
}

std::optional<Comparison> RecordingComparison::result(std::int64_t steps) const {
  if (samples_ == 0) return std::nullopt;
  return Comparison{1e3 * error_sum_rad_ / static_cast<double>(samples_), baseline_mae_mrad(steps)};
}

/// The same recording on the same mechanism with MuJoCo's own frictionloss and damping.
double RecordingComparison::baseline_mae_mrad(std::int64_t steps) const {
  const SetPoints& r = *scenario_.recording;
  const mjModel* m = scenario_.baseline->get();
  const double timestep_s = scenario_.model->get()->opt.timestep;
  const mujoco::DataPtr d = scenario_.baseline->make_data();
  d->qpos[0] = r.measured_rad[0][0];
  double sum = 0;
  std::size_t next = 0, goal = 0, count = 0;
  for (std::int64_t k = 0; k < steps; ++k) {
    const double t = static_cast<double>(k) * timestep_s;
    while (next < r.time_s.size() && r.time_s[next] - r.time_s[0] <= t + 1e-12) {
      sum += std::abs(d->qpos[0] - r.measured_rad[0][next++]);
      ++count;
    }
    while (goal + 1 < r.time_s.size() && r.time_s[goal + 1] - r.time_s[0] + scenario_.baseline_delay_s <= t) ++goal;
    const bool on = next == 0 || r.torque_on.empty() || r.torque_on[next - 1];
    d->ctrl[0] = on ? dc_torque_nm(scenario_.baseline_control, r.position_rad[0][goal] - d->qpos[0], d->qvel[0]) : 0;
    mj_step(m, d.get());
  }
  return 1e3 * sum / static_cast<double>(std::max<std::size_t>(1, count));
}

}  // namespace tribotwin::twin
