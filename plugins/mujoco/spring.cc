#include <cmath>

#include <fmt/format.h>

#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/plugins/mujoco/spring.hpp>

namespace tribotwin::mujoco {

Result<Spring> bind_spring(const mjModel* m, transmission::Hysteresis hysteresis, Binding drive, int actuator) {
  const auto fail = [&](std::string_view what) {
    return tl::unexpected(fmt::format("transmission '{}': {}", hysteresis.name, what));
  };
  if (m->actuator_trntype[actuator] != mjTRN_TENDON) return fail("must act on a tendon (tendon=\"...\")");
  Spring s;
  s.actuator = actuator;
  s.tendon = m->actuator_trnid[2 * actuator];
  s.control = engine::control_address(m, actuator);
  s.force = engine::force_address(m, actuator);
  const char* given = mj_id2name(m, mjOBJ_TENDON, s.tendon);
  const std::string tendon = given ? given : std::to_string(s.tendon);
  if (m->actuator_gear[6 * s.force] != 1) return fail("gear must stay 1; the ratio is in the tendon's coefficients");
  for (int i = m->tendon_adr[s.tendon]; i < m->tendon_adr[s.tendon] + m->tendon_num[s.tendon]; ++i) {
    if (m->wrap_type[i] != mjWRAP_JOINT)
      return fail(fmt::format("tendon '{}' must be <fixed>, of joints with coefficients 1/u and -1", tendon));
    s.torsion.push_back({m->jnt_qposadr[m->wrap_objid[i]], m->wrap_prm[i]});
  }
  const double omega = std::sqrt(hysteresis.stiffest() * m->tendon_invweight0[s.tendon]), longest = 1 / omega;
  if (m->opt.timestep > longest) {
    const double scale = std::pow(10, std::floor(std::log10(longest)));
    return fail(
        fmt::format("tendon '{}': time step {:g} s is too long for its stiffness, which swings the inertias at up to "
                    "{:.3g} rad/s; {:g} s works",
                    tendon, m->opt.timestep, omega, std::floor(longest / scale) * scale));
  }
  s.hysteresis = std::move(hysteresis);
  s.drive = std::move(drive);
  return s;
}

double& hysteretic_rad(mjData* d, const Spring& s) { return engine::state(d)[s.state_address]; }
double hysteretic_rad(const mjData* d, const Spring& s) { return engine::state(d)[s.state_address]; }
SpringWorkspace& workspace(mjData* d, const Spring& s) {
  return *reinterpret_cast<SpringWorkspace*>(engine::workspace(d) + s.workspace_address);
}
const SpringWorkspace& workspace(const mjData* d, const Spring& s) {
  return *reinterpret_cast<const SpringWorkspace*>(engine::workspace(d) + s.workspace_address);
}

double spring_torque(const mjModel* m, mjData* d, const Spring& spring) {
  SpringWorkspace& s = workspace(d, spring);
  s.torsion_rad = spring.torsion_rad(d);
  double x = hysteretic_rad(d, spring);
  const bool later_stage = m->opt.integrator == mjINT_RK4 && s.step_open != 0 && d->time > s.step_time_s &&
                           d->time <= s.step_time_s + m->opt.timestep * (1 + 1e-9);
  if (later_stage) {
    x = transmission::advance(spring.hysteresis, x, s.torsion_rad - s.torsion_begin_rad);
  } else {
    s.step_open = 1;
    s.step_time_s = d->time;
    s.torsion_begin_rad = s.torsion_rad;
  }
  s.torque_nm = transmission::torque_nm(spring.hysteresis, s.torsion_rad, x,
                                        drive::temperature_degC(spring.drive.drive, state(d, spring.drive)));
  return s.torque_nm;
}

void book_spring(mjData* d, const Spring& spring) {
  SpringWorkspace& s = workspace(d, spring);
  s.step_open = 0;
  double& x = hysteretic_rad(d, spring);
  const auto after = transmission::advance(spring.hysteresis, x, s.torsion_begin_rad, spring.torsion_rad(d),
                                           drive::temperature_degC(spring.drive.drive, state(d, spring.drive)));
  x = after.x_rad;
  s.heat_J += after.heat_J;
  drive::Workspace& gear = workspace(d, spring.drive);
  gear.added_heat_J += after.heat_J;
}

}  // namespace tribotwin::mujoco
