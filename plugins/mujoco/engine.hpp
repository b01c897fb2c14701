#pragma once

#include <mujoco/mujoco.h>

/// The differences between the engine versions, in one place.
namespace tribotwin::mujoco::engine {

/// Engine plugins exist; before, the drive is driven by callbacks.
#if mjVERSION_HEADER >= 320
#define TRIBOTWIN_ENGINE_PLUGINS 1
#else
#define TRIBOTWIN_ENGINE_PLUGINS 0
#endif

inline int control_address(const mjModel* m, int actuator) {
#if mjVERSION_HEADER >= 3011000
  return m->actuator_ctrladr[actuator];
#else
  (void)m;
  return actuator;
#endif
}

inline int force_address(const mjModel* m, int actuator) {
#if mjVERSION_HEADER >= 3011000
  return m->actuator_outadr[actuator];
#else
  (void)m;
  return actuator;
#endif
}

inline int actuator_count(const mjModel* m) {
#if mjVERSION_HEADER >= 3011000
  return static_cast<int>(m->nactuator);
#else
  return static_cast<int>(m->nu);
#endif
}

/// A warning of the visualiser, which later engines do not have.
inline bool concerns_pictures(int warning) {
#if mjVERSION_HEADER < 3011000
  return warning == mjWARN_VGEOMFULL;
#else
  (void)warning;
  return false;
#endif
}

/// Where elements store their state, which a restart needs, and their workspace, which it does not.
#if TRIBOTWIN_ENGINE_PLUGINS
inline mjtNum* state(const mjData* d) { return d->act; }
inline mjtNum* workspace(const mjData* d) { return d->plugin_state; }
#else
inline mjtNum* state(const mjData* d) { return d->userdata; }
inline mjtNum* workspace(const mjData* d) { return d->userdata; }
#endif

/// The control of an actuator, with its delay if it has one.
inline double control(const mjModel* m, const mjData* d, int actuator, int address) {
#if mjVERSION_HEADER >= 3005000
  if (m->actuator_delay[actuator] > 0)
    return mj_readCtrl(m, d, actuator, d->time, m->actuator_history[2 * actuator + 1]);
#endif
  (void)m, (void)actuator;
  return d->ctrl[address];
}

/// Whether <option actuatorgroupdisable="..."/> switches the actuator off.
inline bool is_disabled(const mjModel* m, int actuator) {
#if TRIBOTWIN_ENGINE_PLUGINS
  const int group = m->actuator_group[actuator];
  return group >= 0 && group <= 30 && (m->opt.disableactuator & (1 << group)) != 0;
#else
  (void)m, (void)actuator;
  return false;
#endif
}

/// The rotor's share of a joint's inertia: <joint armature> and <actuator armature>, at a gear ratio of `gear`.
inline double rotor_inertia(const mjModel* m, int dof, int actuator, double gear) {
#if mjVERSION_HEADER >= 3007000
  return m->dof_armature[dof] + m->actuator_armature[actuator] * gear * gear;
#else
  (void)actuator, (void)gear;
  return m->dof_armature[dof];
#endif
}

/// A joint torque within <joint actuatorfrcrange>.
inline double within_joint_range(const mjModel* m, int joint, double torque_nm) {
#if TRIBOTWIN_ENGINE_PLUGINS
  if (m->jnt_actfrclimited[joint])
    return mju_clip(torque_nm, m->jnt_actfrcrange[2 * joint], m->jnt_actfrcrange[2 * joint + 1]);
#endif
  (void)m, (void)joint;
  return torque_nm;
}

/// Whether the engine hands the joint's gravity compensation to its actuators.
inline bool compensates_gravity(const mjModel* m, int joint) {
#if TRIBOTWIN_ENGINE_PLUGINS
  return m->jnt_actgravcomp[joint] != 0;
#else
  (void)m, (void)joint;
  return false;
#endif
}

/// Whether mj_passive calls callbacks and plugins: it returns early where all passive forces are disabled.
inline bool calls_passive(const mjModel* m) {
#if mjVERSION_HEADER >= 336
  constexpr int all = mjDSBL_SPRING | mjDSBL_DAMPER;
#else
  constexpr int all = mjDSBL_PASSIVE;
#endif
  return (m->opt.disableflags & all) != all;
}

/// Row of a dof's friction constraint, or -1. `hint` is its place among the dofs with friction, where the row is found
/// without a search.
inline int friction_row(const mjData* d, int dof, int hint) {
  const auto is = [&](int row) { return d->efc_type[row] == mjCNSTR_FRICTION_DOF && d->efc_id[row] == dof; };
  if (hint < d->nf && is(d->ne + hint)) return d->ne + hint;
  for (int row = d->ne; row < d->ne + d->nf; ++row)
    if (is(row)) return row;
  return -1;
}

inline void set_friction_limit(mjData* d, int row, double limit_nm) {
  d->efc_frictionloss[row] = limit_nm;
#if mjVERSION_HEADER >= 333
  // The island solvers read a copy that was made before plugins and callbacks run.
  if (d->nisland > 0) d->iefc_frictionloss[d->map_efc2iefc[row]] = limit_nm;
#endif
}

}  // namespace tribotwin::mujoco::engine
