#include <cmath>

#include <tribotwin/twin/live/protocol/law.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::twin::live {
namespace {

constexpr int points = 81;

/// Joint side [rad/s]: of the model, else the end of the law's range, else 1.
double top_speed(const mujoco::Model& model, std::size_t i) {
  if (const auto most = joint_speed_max_rad_s(model, i)) return *most;
  const drive::Drive& drive = model.drives()[i].drive;
  const double range = drive.law.range.speed_max_rad_s / drive.speed_scale();
  return std::isfinite(range) ? range : 1;
}

}  // namespace

Law law_of(const mujoco::Model& model, std::size_t i, const drive::Workspace& state) {
  drive::Drive drive = model.drives()[i].drive;
  drive.law = drive::current_law(drive, state);
  const double top = top_speed(model, i) * drive.gear_ratio;
  Law law{.joint = joint_name(model.get(), model.drives()[i]),
          .temperature_degC = state.temperature_degC,
          .load_norm = state.load_used_nm / drive.torque_max_nm};
  for (int k = 0; k < points; ++k) {
    const double speed = -top + 2 * top * k / (points - 1);
    law.speed_rad_s.push_back(speed);
    law.friction_nm.push_back(
        mujoco::friction_nm(drive, speed / drive.gear_ratio, law.load_norm, law.temperature_degC));
  }
  return law;
}

}  // namespace tribotwin::twin::live
