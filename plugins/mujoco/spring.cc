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

Result<std::size_t> drive_of(const mjModel* m, const transmission::Hysteresis& hysteresis, int actuator,
                             std::span<const NamedDrive> drives) {
  const int tendon = m->actuator_trnid[2 * actuator];
  const auto on_tendon = [&](const NamedDrive& drive) {
    if (m->actuator_trntype[actuator] != mjTRN_TENDON) return false;
    for (int i = m->tendon_adr[tendon]; i < m->tendon_adr[tendon] + m->tendon_num[tendon]; ++i)
      if (m->wrap_type[i] == mjWRAP_JOINT && m->wrap_objid[i] == drive.joint) return true;
    return false;
  };
  std::vector<std::size_t> found;
  for (std::size_t i = 0; i < drives.size(); ++i)
    if (on_tendon(drives[i]) && drives[i].instance.ends_with(hysteresis.drive)) found.push_back(i);
  if (found.size() == 1) return found.front();
  for (std::size_t i = 0; i < drives.size(); ++i)
    if (drives[i].instance == hysteresis.drive) return i;
  if (hysteresis.drive.empty())
    return tl::unexpected<Error>(fmt::format(
        "transmission '{}': {} on joints of its tendon; name one instance of tribotwin.drive in the key 'drive'",
        hysteresis.name, found.empty() ? "no drive acts" : "several drives act"));
  return tl::unexpected<Error>(
      fmt::format("transmission '{}': key 'drive' is '{}', which is no instance of {} that an actuator uses",
                  hysteresis.name, hysteresis.drive, plugin_name));
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
  const bool later_stage = m->opt.integrator == mjINT_RK4 && drive::within_step(s, d->time, m->opt.timestep);
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
