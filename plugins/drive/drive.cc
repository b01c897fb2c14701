#include <tribotwin/plugins/drive/drive.hpp>

#include <algorithm>
#include <cmath>

namespace tribotwin::drive {
namespace {

// Friction is evaluated at temperatures rounded to 61 uK, so that its coefficients stay cached for many steps and yet
// depend on nothing but the state: a restart from saved state repeats every bit.
constexpr double temperature_steps_per_K = 16384;

// The engine's constraint vanishes at a limit of 0; friction this small is none.
constexpr double smallest_limit_nm = 1e-12;

}  // namespace

double temperature_degC(const Drive& drive, const Memory& memory) {
  return drive.thermal.T_amb_degC + memory.rise.total_K();
}

void set_temperature(const Drive& drive, Memory& memory, double temperature_degC) {
  memory.rise = thermal::settled(drive.thermal, temperature_degC - drive.thermal.T_amb_degC);
}

void set_wear(Scratch& scratch, std::size_t index, double factor) {
  scratch.change[index] = factor - 1;
  scratch.worn = std::ranges::any_of(scratch.change, [](double change) { return change != 0; });
  scratch.cache_valid = 0;
}

friction::Law current_law(const Drive& drive, const Scratch& scratch) {
  if (scratch.worn == 0) return drive.law;
  auto worn = drive.law.parameters;
  for (std::size_t i = 0; i < worn.size(); ++i) worn[i] *= 1 + scratch.change[i];
  return friction::with_parameters(drive.law, {worn.data(), drive.law.info->parameters.size()});
}

double begin_step(const Drive& drive, const Memory& memory, Scratch& s, double time_s, double qd_rad_s) {
  s.step_open = 1;
  s.step_time_s = time_s;
  s.qd_begin_rad_s = qd_rad_s;

  const double temperature =
      std::round(temperature_degC(drive, memory) * temperature_steps_per_K) / temperature_steps_per_K;
  if (s.cache_valid == 0 || temperature != s.temperature_degC) {
    const friction::AtTemperature at = friction::at_temperature(current_law(drive, s), temperature);
    s.cache = at.coefficients;
    s.cache_outside = at.outside;
    s.cache_valid = 1;
    s.temperature_degC = temperature;
  }
  s.load_used_nm = memory.load_nm;
  const friction::Level level =
      friction::level(drive.law, {s.cache, s.cache_outside != 0}, qd_rad_s * drive.speed_scale(),
                      memory.load_nm / drive.torque_max_nm);
  s.outside = level.outside;
  s.gear_limit_nm = std::max(level.total() * drive.torque_scale_nm(), smallest_limit_nm);
  s.limit_nm = s.gear_limit_nm + s.brake_engaged * drive.brake_torque_nm;
  return s.limit_nm;
}

void end_step(const Drive& drive, const thermal::Decay& decay, const Transmitted& t, double dt_s, Memory& memory,
              Scratch& s) {
  s.step_open = 0;
  // Mean speed times torque is what the constraint took out of the kinetic energy, to rounding; in a step that
  // reverses the motion it may be slightly negative and must stay so for the balance to close.
  const double mean_speed = 0.5 * (s.qd_begin_rad_s + t.qd_end_rad_s);
  s.friction_nm = t.friction_nm * (s.gear_limit_nm / s.limit_nm);
  s.torque_nm = t.torque_nm;
  const double power_W = s.friction_nm * mean_speed;
  s.friction_work_J += s.friction_nm * mean_speed * dt_s;

  if (s.temperature_held == 0) thermal::step(drive.thermal, decay, power_W, s.ambient_offset_K, memory.rise);
  s.heat_J += power_W * dt_s;

  const double acceleration = (t.qd_end_rad_s - s.qd_begin_rad_s) / dt_s;
  const double load = t.torque_nm - t.friction_nm - t.rotor_inertia_kg_m2 * acceleration;
  memory.load_nm += (load - memory.load_nm) * (drive.load_filter_s > 0 ? -std::expm1(-dt_s / drive.load_filter_s) : 1);

  s.steps_outside += s.outside;
  if (std::abs(t.friction_nm) < s.limit_nm * (1 - 1e-9)) s.stuck_s += dt_s;
}

}  // namespace tribotwin::drive
