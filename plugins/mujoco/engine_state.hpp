#pragma once

#include <cstddef>
#include <vector>

#include <tribotwin/plugins/mujoco/engine.hpp>

namespace tribotwin::mujoco::engine {

/// Everything that the next steps of d depend on, as numbers for `s(first, count)`, which reads or writes them. What
/// the engine computes anew in each step is no part of it.
template <class Numbers>
void all_state(const mjModel* m, mjData* d, Numbers& s) {
#if TRIBOTWIN_ENGINE_PLUGINS
  std::vector<mjtNum> all(static_cast<std::size_t>(mj_stateSize(m, mjSTATE_INTEGRATION)));
  mj_getState(m, d, all.data(), mjSTATE_INTEGRATION);
  s(all.data(), all.size());
  if (s.restores()) mj_setState(m, d, all.data(), mjSTATE_INTEGRATION);
#else
  const auto part = [&](mjtNum* first, int count) { s(first, static_cast<std::size_t>(count)); };
  part(&d->time, 1);
  part(d->qpos, m->nq), part(d->qvel, m->nv), part(d->act, m->na);
  part(d->qacc_warmstart, m->nv), part(d->ctrl, m->nu);
  part(d->qfrc_applied, m->nv), part(d->xfrc_applied, 6 * m->nbody);
  part(d->mocap_pos, 3 * m->nmocap), part(d->mocap_quat, 4 * m->nmocap);
  part(d->userdata, m->nuserdata);
#endif
}

}  // namespace tribotwin::mujoco::engine
