#include <algorithm>
#include <cmath>
#include <vector>

#include <tribotwin/twin/experiments/friction/warmup.hpp>

namespace tribotwin::twin {
namespace {

double power_W(const drive::Drive& drive, double speed_rad_s, double load_norm, double rise_K) {
  if (speed_rad_s == 0) return 0;
  const auto at = friction::at_temperature(drive.law, drive.thermal.T_amb_degC + rise_K);
  return friction::level(drive.law, at, speed_rad_s * drive.speed_scale(), load_norm).total() *
         drive.torque_scale_nm() * std::abs(speed_rad_s);
}

/// One step with the power at its middle.
thermal::Rise advance(const drive::Drive& drive, const thermal::Decay& decay, const thermal::Rise& rise,
                      double ambient_offset_K, double speed_rad_s, double load_norm) {
  thermal::Rise guess = rise, result = rise;
  thermal::step(drive.thermal, decay, power_W(drive, speed_rad_s, load_norm, rise.total_K()), ambient_offset_K, guess);
  thermal::step(drive.thermal, decay, power_W(drive, speed_rad_s, load_norm, 0.5 * (rise.total_K() + guess.total_K())),
                ambient_offset_K, result);
  return result;
}

}  // namespace

thermal::Rise after_steady_work(const drive::Drive& drive, thermal::Rise rise, double ambient_offset_K,
                                double speed_rad_s, double load_norm, double duration_s) {
  const double fastest_s = drive.thermal.fastest_s();
  const double steps = std::clamp(std::ceil(duration_s / (0.01 * fastest_s)), 1.0, 1e5);
  const thermal::Decay decay = thermal::decay(drive.thermal, duration_s / steps);
  for (double k = 0; k < steps; ++k) rise = advance(drive, decay, rise, ambient_offset_K, speed_rad_s, load_norm);
  return rise;
}

thermal::Rise after_motion(const drive::Drive& drive, thermal::Rise rise, double ambient_offset_K, const Motion& motion,
                           std::size_t joint, const std::function<double(double)>& load_nm) {
  const double steps = std::ceil(motion.duration_s() / 0.05);
  const double dt = motion.duration_s() / steps;
  const thermal::Decay decay = thermal::decay(drive.thermal, dt);
  std::vector<SetPoint> at(motion.joints());
  for (double k = 0; k < steps; ++k) {
    motion.at((k + 0.5) * dt, at);
    rise = advance(drive, decay, rise, ambient_offset_K, at[joint].velocity_rad_s,
                   load_nm(at[joint].position_rad) / drive.torque_max_nm);
  }
  return rise;
}

}  // namespace tribotwin::twin
