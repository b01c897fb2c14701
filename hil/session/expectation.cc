#include <algorithm>
#include <cmath>

#include <tribotwin/hil/session/expectation.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::hil {
namespace {

constexpr double standing_motor_rad_s = 0.5;  // slower motors count as standing

}  // namespace

Expectation::Expectation(const twin::Scenario& scenario, double cycle_s)
    : model_(*scenario.model), data_(model_.make_data()), cycle_s_(cycle_s), drives_(model_.drives().size()) {
  for (std::size_t i = 0; i < drives_.size(); ++i) {
    const auto& thermal = model_.drives()[i].drive.thermal;
    drives_[i].decay = thermal::decay(thermal, cycle_s);
    drives_[i].rise = thermal::steady_rise(thermal, scenario.temperature_degC[i] - thermal.T_amb_degC);
    drives_[i].ambient_offset_K = scenario.ambient_degC ? *scenario.ambient_degC - thermal.T_amb_degC : 0;
  }
}

double Expectation::temperature_degC(std::size_t drive) const {
  return model_.drives()[drive].drive.thermal.T_amb_degC + drives_[drive].rise.total_K();
}

bool Expectation::add(std::span<const double> position_rad) {
  ++samples_;
  for (std::size_t i = 0; i < drives_.size(); ++i) {
    auto& q = drives_[i].q;
    std::rotate(q.begin(), q.begin() + 1, q.end());
    q.back() = position_rad[i];
  }
  if (samples_ < window) return false;
  fit_motion();
  const mjModel* m = model_.get();
  mjData* d = data_.get();
  mj_kinematics(m, d);
  mj_comPos(m, d);
  mj_comVel(m, d);
  gear_nm_.resize(static_cast<std::size_t>(m->nv));
  mj_rne(m, d, 1, gear_nm_.data());  // without the rotors: the torques of the gears
  for (std::size_t i = 0; i < drives_.size(); ++i) expect(i);
  return true;
}

void Expectation::fit_motion() {
  constexpr double n = window, s2 = 110, s4 = 1958, det = n * s4 - s2 * s2;  // sums of k^2 and k^4 over -5..5
  mjData* d = data_.get();
  for (std::size_t i = 0; i < drives_.size(); ++i) {
    double sum = 0, first = 0, second = 0;
    for (int k = -half; k <= half; ++k) {
      const double q = drives_[i].q[static_cast<std::size_t>(k + half)];
      sum += q, first += k * q, second += k * k * q;
    }
    const auto& b = model_.drives()[i];
    d->qpos[twin::position_address(model_.get(), b)] = (s4 * sum - s2 * second) / det;
    d->qvel[b.dof] = first / s2 / cycle_s_;
    d->qacc[b.dof] = 2 * (n * second - s2 * sum) / det / (cycle_s_ * cycle_s_);
  }
}

void Expectation::expect(std::size_t i) {
  const auto& b = model_.drives()[i];
  const mjData* d = data_.get();
  Drive& drive = drives_[i];
  const double load = gear_nm_[static_cast<std::size_t>(b.dof)], speed = d->qvel[b.dof],
               rotor = model_->dof_armature[b.dof] * d->qacc[b.dof];
  const bool slides = std::abs(speed) * b.drive.gear_ratio > standing_motor_rad_s;
  const double friction =
      mujoco::friction_nm(b.drive, slides ? speed : 0, load / b.drive.torque_max_nm, temperature_degC(i));
  drive.low_nm = load + rotor + (slides && speed > 0 ? friction : -friction);
  drive.high_nm = load + rotor + (slides && speed < 0 ? -friction : friction);
  thermal::step(b.drive.thermal, drive.decay, slides ? friction * std::abs(speed) : 0, drive.ambient_offset_K,
                drive.rise);
}

}  // namespace tribotwin::hil
