#include <tribotwin/plugins/mujoco/binding.hpp>

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/plugins/mujoco/engine.hpp>

namespace tribotwin::mujoco {
namespace {

/// Joint speed at which a stuck joint under 90 % of its breakaway torque may drift.
constexpr double creep_limit_rad_s = 1e-5;

std::string joint_name(const mjModel* m, int joint) {
  const char* name = mj_id2name(m, mjOBJ_JOINT, joint);
  return name ? fmt::format("joint '{}'", name) : fmt::format("joint {}", joint);
}

/// Temperatures at which a law is extreme within its range.
std::vector<double> extreme_temperatures(const drive::Drive& drive) {
  std::vector<double> temperatures{drive.thermal.T_amb_degC};
  for (const double T : {drive.law.range.temperature_min_degC, drive.law.range.temperature_max_degC})
    if (drive.law.info->temperature_dependent && std::isfinite(T)) temperatures.push_back(T);
  return temperatures;
}

/// Speed at which a joint under 90 % of its breakaway torque drifts, from the softness of its friction row.
double creep_rad_s(const mjModel* m, const drive::Drive& drive, int dof) {
  double breakaway_nm = 0;
  const double load = std::isfinite(drive.law.range.load_max) ? drive.law.range.load_max : 0;
  for (const double T : extreme_temperatures(drive)) breakaway_nm = std::max(breakaway_nm, friction_nm(drive, 0, load, T));
  const mjtNum* solref = m->dof_solref + mjNREF * dof;
  const mjtNum* solimp = m->dof_solimp + mjNIMP * dof;
  const double d0 = std::clamp<double>(solimp[0], mjMINIMP, mjMAXIMP), dmax = std::clamp<double>(solimp[1], mjMINIMP, mjMAXIMP);
  double damping = -solref[1] / dmax;
  if (solref[0] > 0) {
    const bool safe = !(m->opt.disableflags & mjDSBL_REFSAFE);
    damping = 2 / (dmax * (safe ? std::max<double>(solref[0], 2 * m->opt.timestep) : solref[0]));
  }
  return 0.9 * breakaway_nm / m->dof_M0[dof] * (1 - d0) / d0 / damping;
}

/// Longest time step in which friction, evaluated at the speed of the step's start, does not ring.
double longest_time_step_s(const mjModel* m, const drive::Drive& drive, int dof) {
  constexpr int points = 400;
  const double top = std::min(drive.law.range.speed_max_rad_s / drive.speed_scale(), 100.0);
  double slope = 0;   // Nm s/rad, arm side
  for (const double T : extreme_temperatures(drive)) {
    double before = friction_nm(drive, top / points, 0, T);
    for (int i = 2; i <= points; ++i) {
      const double now = friction_nm(drive, top * i / points, 0, T);
      slope = std::max(slope, (now - before) / (top / points));
      before = now;
    }
  }
  return slope > 0 ? 1 / (slope * m->dof_invweight0[dof]) : friction::unlimited;
}

}  // namespace

double friction_nm(const drive::Drive& drive, double qd_rad_s, double load_norm, double temperature_degC) {
  const auto at = friction::at_temperature(drive.law, temperature_degC);
  return friction::level(drive.law, at, qd_rad_s * drive.speed_scale(), load_norm).total() * drive.torque_scale_nm();
}

double needed_tolerance(int solver) { return solver == mjSOL_CG ? 1e-12 : 1e-8; }
int needed_iterations(int solver) { return solver == mjSOL_NEWTON ? 20 : 100; }

tl::expected<Binding, std::string> bind(const mjModel* m, drive::Drive drive, int actuator) {
  const auto fail = [&](std::string_view where, std::string_view what) {
    return tl::unexpected(fmt::format("drive '{}', {}: {}", drive.name, where, what));
  };
  if (m->actuator_trntype[actuator] != mjTRN_JOINT) return fail("actuator", "must act on a joint (joint=\"...\")");
  Binding b;
  b.actuator = actuator;
  b.joint = m->actuator_trnid[2 * actuator];
  const std::string joint = joint_name(m, b.joint);
  if (m->jnt_type[b.joint] != mjJNT_HINGE && m->jnt_type[b.joint] != mjJNT_SLIDE)
    return fail(joint, "must be a hinge or a slide");
  b.dof = m->jnt_dofadr[b.joint];
  b.control = engine::control_address(m, actuator);
  b.force = engine::force_address(m, actuator);
  b.gear = m->actuator_gear[6 * b.force];
  b.row_hint = static_cast<int>(std::count_if(m->dof_frictionloss, m->dof_frictionloss + b.dof, [](mjtNum x) { return x > 0; }));

  if (!(m->dof_frictionloss[b.dof] > 0))
    return fail(joint, "has no frictionloss, so the solver has no friction row for it; give the joint frictionloss=\"1\" "
                       "(any positive value: the drive replaces it every step)");
  if (m->opt.disableflags & (mjDSBL_FRICTIONLOSS | mjDSBL_CONSTRAINT | mjDSBL_ACTUATION))
    return fail("<option><flag>", "frictionloss, constraint and actuation must stay enabled");
  const double needed = needed_tolerance(m->opt.solver);
  if (m->opt.tolerance > needed * (1 + 1e-9))
    return fail("<option>", fmt::format("tolerance=\"{:g}\" would let a stuck joint creep; this solver needs {:g} or less",
                                        m->opt.tolerance, needed));
  if (const int iterations = needed_iterations(m->opt.solver); m->opt.iterations < iterations)
    return fail("<option>", fmt::format("iterations=\"{}\" would let a stuck joint creep; use {} or more", m->opt.iterations, iterations));
  if (const double creep = creep_rad_s(m, drive, b.dof); creep > creep_limit_rad_s)
    return fail(joint, fmt::format("stiction settings are soft: under 90 % of its breakaway torque the joint would creep at "
                                   "{:.2g} rad/s (limit {:g}); give the joint solreffriction=\".001 1\" "
                                   "solimpfriction=\".9999 .9999 .001 .5 2\", or shorten the time step",
                                   creep, creep_limit_rad_s));
  if (const double longest = longest_time_step_s(m, drive, b.dof); m->opt.timestep > longest) {
    const double scale = std::pow(10, std::floor(std::log10(longest)));
    return fail(joint, fmt::format("time step {:g} s is too long for its viscous friction, which would ring; {:g} s works",
                                   m->opt.timestep, std::floor(longest / scale) * scale));
  }
  b.decay = thermal::decay(drive.thermal, m->opt.timestep);
  b.drive = std::move(drive);
  return b;
}

#if TRIBOTWIN_ENGINE_PLUGINS
static mjtNum* memory_array(const mjData* d) { return d->act; }
static mjtNum* scratch_array(const mjData* d) { return d->plugin_state; }
#else
static mjtNum* memory_array(const mjData* d) { return d->userdata; }
static mjtNum* scratch_array(const mjData* d) { return d->userdata; }
#endif

drive::Memory& memory(mjData* d, const Binding& b) {
  return *reinterpret_cast<drive::Memory*>(memory_array(d) + b.memory_address);
}
drive::Scratch& scratch(mjData* d, const Binding& b) {
  return *reinterpret_cast<drive::Scratch*>(scratch_array(d) + b.scratch_address);
}
const drive::Memory& memory(const mjData* d, const Binding& b) {
  return *reinterpret_cast<const drive::Memory*>(memory_array(d) + b.memory_address);
}
const drive::Scratch& scratch(const mjData* d, const Binding& b) {
  return *reinterpret_cast<const drive::Scratch*>(scratch_array(d) + b.scratch_address);
}

void limit_friction(const mjModel* m, mjData* d, const Binding& b) {
  drive::Scratch& s = scratch(d, b);
  const bool later_stage = m->opt.integrator == mjINT_RK4 && drive::within_step(s, d->time, m->opt.timestep);
  const double limit = later_stage ? s.limit_nm : drive::begin_step(b.drive, memory(d, b), s, d->time, b.speed(d));
  if (const int row = engine::friction_row(d, b.dof, b.row_hint); row >= 0) engine::set_friction_limit(d, row, limit);
}

void book_friction(const mjModel* m, mjData* d, const Binding& b) {
  const int row = engine::friction_row(d, b.dof, b.row_hint);
  const drive::Transmitted transmitted{.friction_nm = row >= 0 ? -d->efc_force[row] : 0,
                                       .torque_nm = d->actuator_force[b.force] * b.gear,
                                       .qd_end_rad_s = b.speed(d),
                                       .rotor_inertia_kg_m2 = m->dof_armature[b.dof]};
  const double dt = m->opt.timestep;
  drive::end_step(b.drive, dt == b.decay.dt_s ? b.decay : thermal::decay(b.drive.thermal, dt), transmitted, dt,
                  memory(d, b), scratch(d, b));
}

}  // namespace tribotwin::mujoco
