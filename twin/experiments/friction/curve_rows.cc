#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/experiments/friction/curve_rows.hpp>
#include <tribotwin/twin/experiments/friction/random.hpp>

namespace tribotwin::twin {

Result<std::string> measured_rows(const Campaign& campaign, const Curve& curve) {
  const mujoco::Model& bench = *campaign.benches[curve.bench];
  const drive::Drive& drive = campaign.model->drives()[campaign.drive].drive;
  const Measurement& me = curve.measurement;
  const auto fail = [&](const std::string& why) {
    return work_failed(
        fmt::format("curve {} of series '{}' ({}): {}", curve.number, curve.series, curve.conditions, why));
  };
  const auto motion = campaign.procedure == Procedure::test_cycle ? test_cycle_of(bench, campaign.drive, me.start_rad)
                                                                  : plus_minus(bench, campaign.drive, me);
  if (!motion) return fail(motion.error().message);
  const auto recording = record(bench, campaign.drive, *motion, me);
  if (!recording) return fail(recording.error().message);
  const auto found = levels_of(
      *recording,
      {.speeds_rad_s = me.speeds_rad_s, .centre_rad = me.start_rad[campaign.drive], .width_rad = me.width_rad});
  if (!found) return fail(found.error().message);
  std::mt19937_64 random = random_for(campaign.seed, curve.number, for_levels);
  std::normal_distribution<double> noise;
  std::string rows;
  for (const Level& level : found->levels) {
    const double error = campaign.level_noise_nm > 0 ? campaign.level_noise_nm * noise(random) : 0;
    const double norm = 1 / drive.torque_max_nm, stderr_nm = std::hypot(level.stderr_nm, campaign.level_noise_nm),
                 friction = level.friction_nm + error;
    rows += fmt::format("{},{},{},{},{},{},{},{},{},{},{},{},{},{}\n", curve.series, curve.number,
                        level.speed_rad_s * drive.gear_ratio, level.load_nm * norm, level.temperature_degC,
                        friction * norm, stderr_nm * norm, (level.forward->friction_nm + error) * norm,
                        (level.backward->friction_nm + error) * norm, friction, stderr_nm, found->lag_s,
                        level.ripple_nm, level.lost_motion_rad);
  }
  return rows;
}

}  // namespace tribotwin::twin
