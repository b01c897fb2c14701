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

/// Where elements keep what a restart needs, and what it does not.
#if TRIBOTWIN_ENGINE_PLUGINS
inline mjtNum* state(const mjData* d) { return d->act; }
inline mjtNum* workspace(const mjData* d) { return d->plugin_state; }
#else
inline mjtNum* state(const mjData* d) { return d->userdata; }
inline mjtNum* workspace(const mjData* d) { return d->userdata; }
#endif

/// Whether mj_passive calls callbacks and plugins: it returns early where all passive forces are disabled.
inline bool calls_passive(const mjModel* m) {
#if mjVERSION_HEADER >= 336
  constexpr int all = mjDSBL_SPRING | mjDSBL_DAMPER;
#else
  constexpr int all = mjDSBL_PASSIVE;
#endif
  return (m->opt.disableflags & all) != all;
}

/// Row of a dof's friction constraint, or -1. `hint` is where it is as long as no equality constraint comes or goes
/// ahead of it: its place among the dofs with friction.
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
