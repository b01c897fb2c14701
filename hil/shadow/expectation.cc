#include <cmath>

#include <tribotwin/hil/motion/standstill.hpp>
#include <tribotwin/hil/shadow/expectation.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::hil {

Expectation::Expectation(const twin::Scenario& scenario)
    : model_(*scenario.model), data_(model_.make_data()), drives_(model_.drives().size()) {
  for (std::size_t i = 0; i < drives_.size(); ++i) {
    const auto& thermal = model_.drives()[i].drive.thermal;
    drives_[i].rise = thermal::steady_rise(thermal, scenario.temperature_degC[i] - thermal.T_amb_degC);
    drives_[i].winding.rise_K = drives_[i].rise.total_K();
    drives_[i].ambient_offset_K = scenario.ambient_degC ? *scenario.ambient_degC - thermal.T_amb_degC : 0;
  }
}

double Expectation::temperature_degC(std::size_t drive) const {
  return model_.drives()[drive].drive.thermal.T_amb_degC + drives_[drive].rise.total_K();
}

void Expectation::set(std::span<const Motion> motions, double dt_s) {
  const mjModel* m = model_.get();
  mjData* d = data_.get();
  for (std::size_t i = 0; i < drives_.size(); ++i) {
    const auto& b = model_.drives()[i];
    d->qpos[twin::position_address(m, b)] = motions[i].position;
    d->qvel[b.dof] = motions[i].speed;
    d->qacc[b.dof] = motions[i].acceleration;
  }
  mj_kinematics(m, d);
  mj_comPos(m, d);
  mj_comVel(m, d);
  gear_nm_.resize(static_cast<std::size_t>(m->nv));
  mj_rne(m, d, 1, gear_nm_.data());  // without the rotors: the torques of the gears
  for (std::size_t i = 0; i < drives_.size(); ++i) expect(i, dt_s);
}

void Expectation::expect(std::size_t i, double dt_s) {
  const auto& b = model_.drives()[i];
  const mjData* d = data_.get();
  Drive& drive = drives_[i];
  const double load = gear_nm_[static_cast<std::size_t>(b.dof)], speed = d->qvel[b.dof];
  const bool slides = !stands(speed, b.drive.gear_ratio);
  const double friction =
      mujoco::friction_nm(b.drive, slides ? speed : 0, load / b.drive.torque_max_nm, temperature_degC(i));
  drive.rigid_nm = load + model_->dof_armature[b.dof] * d->qacc[b.dof];
  const auto held = [&](double direction) {  // of the level at rest, which is that of the stronger direction
    return friction * drive::direction_factor(b.drive, direction) / drive::direction_factor(b.drive, 0);
  };
  drive.low_nm = (slides ? std::copysign(friction, speed) : -held(-1)) + b.drive.offset_nm;
  drive.high_nm = (slides ? std::copysign(friction, speed) : held(1)) + b.drive.offset_nm;
  const double power_W = (slides ? friction * std::abs(speed) : 0) + heat_winding(i, dt_s);
  thermal::step(b.drive.thermal, thermal::decay(b.drive.thermal, dt_s), power_W, drive.ambient_offset_K, drive.rise);
}

double Expectation::heat_winding(std::size_t i, double dt_s) {
  const auto& of = model_.drives()[i].drive;
  if (!of.winding.present()) return 0;
  Drive& drive = drives_[i];
  const double winding_degC = of.thermal.T_amb_degC + drive.winding.rise_K,
               share = of.winding.torque_share(winding_degC);
  for (double* torque_nm : {&drive.rigid_nm, &drive.low_nm, &drive.high_nm}) *torque_nm /= share;
  const double torque_nm = drive.rigid_nm + (drive.low_nm + drive.high_nm) / 2;
  if (dt_s == 0) return 0;
  return thermal::step(of.winding, winding_degC, torque_nm / of.torque_per_current_nm_A(), drive.rise.total_K(), dt_s,
                       drive.winding)
      .to_gear_W;
}

}  // namespace tribotwin::hil
