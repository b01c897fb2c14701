#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/plugins/mujoco/binding.hpp>
#include <tribotwin/plugins/mujoco/engine.hpp>

namespace tribotwin::mujoco {
namespace {

/// Joint speed at which a stuck joint under 90 % of its breakaway torque may drift.
constexpr double creep_limit_rad_s = 1e-5;

std::string joint_name(const mjModel* m, int joint) {
  const char* name = mj_id2name(m, mjOBJ_JOINT, joint);
  return name ? fmt::format("joint '{}'", name) : fmt::format("joint {}", joint);
}

/// An actuator besides `own` that acts on the joint, or nothing.
std::string other_actuator(const mjModel* m, int joint, int own) {
  for (int i = 0; i < engine::actuator_count(m); ++i) {
    const bool on_joints = m->actuator_trntype[i] == mjTRN_JOINT || m->actuator_trntype[i] == mjTRN_JOINTINPARENT;
    if (i == own || !on_joints || m->actuator_trnid[2 * i] != joint) continue;
    const char* name = mj_id2name(m, mjOBJ_ACTUATOR, i);
    return name ? fmt::format("actuator '{}'", name) : fmt::format("actuator {}", i);
  }
  return {};
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
  for (const double T : extreme_temperatures(drive))
    breakaway_nm = std::max(breakaway_nm, friction_nm(drive, 0, load, T));
  const mjtNum* solref = m->dof_solref + mjNREF * dof;
  const mjtNum* solimp = m->dof_solimp + mjNIMP * dof;
  const double d0 = std::clamp<double>(solimp[0], mjMINIMP, mjMAXIMP),
               dmax = std::clamp<double>(solimp[1], mjMINIMP, mjMAXIMP);
  double damping = -solref[1] / dmax;
  if (solref[0] > 0) {
    const bool safe = !(m->opt.disableflags & mjDSBL_REFSAFE);
    damping = 2 / (dmax * (safe ? std::max<double>(solref[0], 2 * m->opt.timestep) : solref[0]));
  }
  return 0.9 * breakaway_nm / m->dof_M0[dof] * (1 - d0) / d0 / damping;
}

/// Longest time step in which friction, evaluated at the speed of the step's start, does not ring.
double longest_time_step_s(const mjModel* m, drive::Drive drive, int dof) {
  drive.asymmetry = std::abs(drive.asymmetry);  // the stronger direction is the one that rings
  constexpr int points = 400;
  const double top = std::min(drive.law.range.speed_max_rad_s / drive.speed_scale(), 100.0);
  double slope = 0;  // Nm s/rad, arm side
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

/// The largest number of one significant digit that is not above x > 0.
double rounded_down(double x) {
  const double scale = std::pow(10, std::floor(std::log10(x)));
  return std::floor(x / scale) * scale;
}

/// What is wrong with the bristles on this joint at this time step, or nothing. They act as a torque held over the
/// step: with omega the frequency of the joint on its bristles and zeta its damping ratio, that is faithful for omega
/// dt up to 1/2 and 2 zeta omega dt up to 1. Runge-Kutta moves the joint by the mean of the speeds, not by the last
/// one, so the spring gains (omega dt)^2 / 2 per step, which zeta must dissipate.
std::string bristle_fault(const mjModel* m, const drive::Drive& drive, int dof) {
  const bool lugre = drive.dynamics == drive::Dynamics::lugre;
  const double to_joint = drive.torque_scale_nm() * drive.speed_scale() * m->dof_invweight0[dof];
  double stiffness = drive.bristles.sigma0;
  if (!lugre) {
    const double load = std::isfinite(drive.law.range.load_max) ? drive.law.range.load_max : 1;
    double held_nm = (drive.gear_loss.mu_avg + std::abs(drive.gear_loss.mu_dif)) * load * drive.torque_max_nm,
           max_nm = 0;
    for (const double T : extreme_temperatures(drive))
      for (const double l : {load, -load}) max_nm = std::max(max_nm, friction_nm(drive, 0, l, T));
    held_nm = (held_nm + max_nm) * (1 + 2 * std::abs(drive.asymmetry));  // z (1 + asymmetry z) is steepest at z = 1
    stiffness = held_nm / drive.torque_scale_nm() / drive.gear_loss.length_rad;
  }
  const double omega = std::sqrt(stiffness * drive.speed_scale() * to_joint),
               rate = lugre ? drive.bristles.sigma1 * to_joint : 0;
  const double dt = m->opt.timestep, zeta = rate / (2 * omega);
  const bool runge_kutta = m->opt.integrator == mjINT_RK4;
  if (runge_kutta && zeta == 0)
    return fmt::format("its {} no damping, and RK4 would make it ring louder; {}use integrator=\"Euler\"",
                       lugre ? "friction=\"lugre\" has" : "friction=\"gear_loss\" has",
                       lugre ? "give sigma1 above 0 or " : "");
  const double longest = std::min(
      {0.5 / omega, rate > 0 ? 1 / rate : friction::unlimited, runge_kutta ? 2 * zeta / omega : friction::unlimited});
  if (dt > longest * (1 + 1e-9))
    return fmt::format(
        "time step {:g} s is too long for its bristles, which would chatter (on this joint {} makes {:.3g} rad/s "
        "at a damping ratio of {:.2g}); {:g} s works{}",
        dt, lugre ? "sigma0" : "load per h", omega, zeta, rounded_down(longest),
        runge_kutta ? ", or integrator=\"Euler\" may" : "");
  return {};
}

tl::unexpected<Error> refused(const drive::Drive& drive, std::string_view where, std::string_view what) {
  return tl::unexpected<Error>(fmt::format("drive '{}', {}: {}", drive.name, where, what));
}

}  // namespace

double friction_nm(const drive::Drive& drive, double qd_rad_s, double load_norm, double temperature_degC) {
  return drive::friction_nm(drive, friction::at_temperature(drive.law, temperature_degC), qd_rad_s, load_norm);
}

double resistance_nm(const drive::Drive& drive, double qd_rad_s, double load_norm, double temperature_degC) {
  if (qd_rad_s == 0) return drive.offset_nm;
  return std::copysign(friction_nm(drive, qd_rad_s, load_norm, temperature_degC), qd_rad_s) + drive.offset_nm;
}

std::string actdim_message(const drive::Drive& drive) {
  if (drive.winding.present())
    return fmt::format("actdim=\"{}\", the size of a drive's state with a winding", drive::state_size(drive));
  const bool bristles = drive.dynamics != drive::Dynamics::none;
  return fmt::format("actdim=\"{}\", the size of a drive's state {}", drive::state_size(drive),
                     bristles ? "with friction=\"lugre\" or \"gear_loss\" (3 without)"
                              : "(4 with friction=\"lugre\" or \"gear_loss\")");
}

double needed_tolerance(int solver) { return solver == mjSOL_CG ? 1e-12 : 1e-8; }
int needed_iterations(int solver) { return solver == mjSOL_NEWTON ? 20 : 100; }

Result<Binding> bind(const mjModel* m, drive::Drive drive, int actuator) {
  const auto fail = [&](std::string_view where, std::string_view what) { return refused(drive, where, what); };
  if (m->actuator_trntype[actuator] != mjTRN_JOINT)
    return fail("actuator", "must act on a joint (joint=\"...\"), not on a tendon or a site");
  Binding b;
  b.actuator = actuator;
  b.joint = m->actuator_trnid[2 * actuator];
  const std::string joint = joint_name(m, b.joint);
  if (m->jnt_type[b.joint] != mjJNT_HINGE && m->jnt_type[b.joint] != mjJNT_SLIDE)
    return fail(joint, "must be a hinge or a slide");
  b.dof = m->jnt_dofadr[b.joint];
  b.position = m->jnt_qposadr[b.joint];
  b.control = engine::control_address(m, actuator);
  b.force = engine::force_address(m, actuator);
  b.gear = m->actuator_gear[6 * b.force];
  b.row_hint =
      static_cast<int>(std::count_if(m->dof_frictionloss, m->dof_frictionloss + b.dof, [](mjtNum x) { return x > 0; }));

  if (const auto other = other_actuator(m, b.joint, actuator); !other.empty())
    return fail(joint, other + " acts on it, too, and the load of the gear would not be known; remove one of the two");
  if (engine::compensates_gravity(m, b.joint))
    return fail(joint, "actuatorgravcomp=\"true\" hands torque to the drive that it cannot see; remove it");
  if (!(m->dof_frictionloss[b.dof] > 0))
    return fail(joint,
                "has no frictionloss, so the solver has no friction row for it; give the joint frictionloss=\"1\" "
                "(any positive value: the drive replaces it every step)");
  b.decay = thermal::decay(drive.thermal, m->opt.timestep);
  b.drive = std::move(drive);
  if (const auto carried = check_options(m, b); !carried) return tl::unexpected(carried.error());
  return b;
}

Result<void> check_options(const mjModel* m, const Binding& b) {
  const drive::Drive& drive = b.drive;
  const std::string joint = joint_name(m, b.joint);
  const auto fail = [&](std::string_view where, std::string_view what) { return refused(drive, where, what); };
  if (m->opt.disableflags & (mjDSBL_FRICTIONLOSS | mjDSBL_CONSTRAINT | mjDSBL_ACTUATION))
    return fail("<option><flag>", "frictionloss, constraint and actuation must stay enabled");
  const double needed = needed_tolerance(m->opt.solver);
  if (m->opt.tolerance > needed * (1 + 1e-9))
    return fail("<option>",
                fmt::format("tolerance=\"{:g}\" would let a stuck joint creep; this solver needs {:g} or less",
                            m->opt.tolerance, needed));
  if (const int iterations = needed_iterations(m->opt.solver); m->opt.iterations < iterations)
    return fail("<option>", fmt::format("iterations=\"{}\" would let a stuck joint creep; use {} or more",
                                        m->opt.iterations, iterations));
  const bool row_carries_friction = drive.dynamics == drive::Dynamics::none || drive.brake_torque_nm > 0;
  if (const double creep = row_carries_friction ? creep_rad_s(m, drive, b.dof) : 0; creep > creep_limit_rad_s)
    return fail(joint,
                fmt::format("stiction settings are soft: under 90 % of its breakaway torque the joint would creep at "
                            "{:.2g} rad/s (limit {:g}); give the joint solreffriction=\".001 1\" "
                            "solimpfriction=\".9999 .9999 .001 .5 2\", or shorten the time step",
                            creep, creep_limit_rad_s));
  if (const double longest = longest_time_step_s(m, drive, b.dof); m->opt.timestep > longest)
    return fail(joint,
                fmt::format("time step {:g} s is too long for its viscous friction, which would ring; {:g} s works",
                            m->opt.timestep, rounded_down(longest)));
  if (drive.dynamics != drive::Dynamics::none)
    if (const auto wrong = bristle_fault(m, drive, b.dof); !wrong.empty()) return fail(joint, wrong);
  return {};
}

drive::State& state(mjData* d, const Binding& b) {
  return *reinterpret_cast<drive::State*>(engine::state(d) + b.state_address);
}
drive::Workspace& workspace(mjData* d, const Binding& b) {
  return *reinterpret_cast<drive::Workspace*>(engine::workspace(d) + b.workspace_address);
}
const drive::State& state(const mjData* d, const Binding& b) {
  return *reinterpret_cast<const drive::State*>(engine::state(d) + b.state_address);
}
const drive::Workspace& workspace(const mjData* d, const Binding& b) {
  return *reinterpret_cast<const drive::Workspace*>(engine::workspace(d) + b.workspace_address);
}

namespace {

/// The actuator force that the control asks for, within its range.
double asked_force(const mjModel* m, const mjData* d, const Binding& b) {
  if (engine::is_disabled(m, b.actuator)) return 0;
  mjtNum control = engine::control(m, d, b.actuator, b.control);
  if (m->actuator_ctrllimited[b.control] && !(m->opt.disableflags & mjDSBL_CLAMPCTRL)) {
    const mjtNum* range = m->actuator_ctrlrange + 2 * b.control;
    control = mju_clip(control, range[0], range[1]);
  }
  if (mju_isBad(control)) control = 0;  // the engine warns and uses 0 itself
  double force = control;
  if (b.drive.control == drive::Control::position)
    force = b.drive.kp_nm_rad * (control - b.gear * b.angle(d)) - b.drive.kv_nm_s_rad * b.gear * b.speed(d);
  if (!m->actuator_forcelimited[b.actuator]) return force;
  const mjtNum* range = m->actuator_forcerange + 2 * b.actuator;
  return mju_clip(force, range[0], range[1]);
}

/// Joint torque that the engine's actuator gives in excess of what the motor delivers: a weak motor, warm magnets, and
/// where the engine computes the force itself, a drive at its current limit.
double missing_nm(const mjModel* m, const mjData* d, const Binding& b, const drive::Workspace& s) {
  if (!b.drive.winding.present())
    return s.faults.torque_loss == 0 ? 0 : s.faults.torque_loss * commanded_force(m, d, b) * b.gear;
  const double given_nm = drive::within_current_limit(b.drive, s, asked_force(m, d, b) * b.gear),
               engine_nm = TRIBOTWIN_ENGINE_PLUGINS ? given_nm : asked_force(m, d, b) * b.gear;
  return engine_nm - (1 - s.faults.torque_loss) * (1 - s.hot_torque_loss) * given_nm;
}

}  // namespace

double commanded_force(const mjModel* m, const mjData* d, const Binding& b) {
  const double force = asked_force(m, d, b);
  if (!b.drive.winding.present()) return force;
  return drive::within_current_limit(b.drive, workspace(d, b), force * b.gear) / b.gear;
}

void limit_friction(const mjModel* m, mjData* d, const Binding& b, Stage stage, double& passive_nm) {
  drive::Workspace& s = workspace(d, b);
  const bool later_stage = m->opt.integrator == mjINT_RK4 && drive::within_step(s, d->time, m->opt.timestep);
  if (!later_stage && !drive::begun(b.drive, state(d, b), s, d->time, b.speed(d), b.angle(d)))
    drive::begin_step(b.drive, state(d, b), s, d->time, b.speed(d), b.angle(d));
  // Written also where the step was begun already: mj_setState restores the workspace, but neither the constraint row
  // nor qfrc_passive, which may still hold another state's values.
  if (const int row = engine::friction_row(d, b.dof, b.row_hint); row >= 0)
    engine::set_friction_limit(d, row, s.limit_nm);

  double applied_nm = b.drive.dynamics == drive::Dynamics::none ? 0 : -s.applied_nm;
  applied_nm -= b.drive.offset_nm;
  if (const double missing = missing_nm(m, d, b, s); missing != 0) applied_nm -= missing;
  double& passive = d->qfrc_passive[b.dof];
  if (stage == Stage::passive || (!engine::calls_passive(m) && passive == 0)) passive_nm = 0;
  if (applied_nm != passive_nm) passive += applied_nm - passive_nm;
  passive_nm = applied_nm;
}

void book_friction(const mjModel* m, mjData* d, const Binding& b) {
  const int row = engine::friction_row(d, b.dof, b.row_hint);
  const drive::Transmitted transmitted{
      .friction_nm = row >= 0 ? -d->efc_force[row] : 0,
      .torque_nm = drive::within_current_limit(
          b.drive, workspace(d, b), engine::within_joint_range(m, b.joint, d->actuator_force[b.force] * b.gear)),
      .qd_end_rad_s = b.speed(d),
      .q_end_rad = b.angle(d),
      .rotor_inertia_kg_m2 = engine::rotor_inertia(m, b.dof, b.actuator, b.gear)};
  const double dt = m->opt.timestep;
  drive::end_step(b.drive, dt == b.decay.dt_s ? b.decay : thermal::decay(b.drive.thermal, dt), transmitted, dt,
                  state(d, b), workspace(d, b));
}

}  // namespace tribotwin::mujoco
