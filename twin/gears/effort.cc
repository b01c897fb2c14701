#include <algorithm>
#include <cmath>
#include <optional>
#include <random>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/plugins/mujoco/engine.hpp>
#include <tribotwin/twin/gears/effort.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::twin {
namespace {

bool on_joint(const mjModel* m, int actuator) {
  return m->actuator_trntype[actuator] == mjTRN_JOINT || m->actuator_trntype[actuator] == mjTRN_JOINTINPARENT;
}

Effort symmetric(double largest, std::string source) { return {-largest, largest, std::move(source), false}; }

/// Joint torque per control of an actuator whose force is gain x control, else nothing.
std::optional<double> motor_gain(const mjModel* m, int a) {
  if (m->actuator_gaintype[a] != mjGAIN_FIXED || m->actuator_biastype[a] != mjBIAS_NONE) return {};
  return m->actuator_gainprm[a * mjNGAIN] * m->actuator_gear[6 * a];
}

std::optional<Effort> given(const ForeignModel& foreign, int joint) {
  const mjModel* m = foreign.model->get();
  const auto limit = foreign.limits.find(mj_id2name(m, mjOBJ_JOINT, joint) ? mj_id2name(m, mjOBJ_JOINT, joint) : "");
  if (limit != foreign.limits.end() && limit->second.effort_nm > 0)
    return symmetric(limit->second.effort_nm, "effort of the URDF");
  return actuator_effort(m, joint);
}

Effort estimated(const mjModel* m, int joint, const std::vector<double>& loads) {
  double effort = loads[m->jnt_dofadr[joint]];
  // The last joint of an arm carries next to nothing, and still no robot has a wrist of less than a tenth.
  for (int j = 0; j < m->njnt; ++j)
    if (m->jnt_type[j] == m->jnt_type[joint] &&
        m->body_rootid[m->jnt_bodyid[j]] == m->body_rootid[m->jnt_bodyid[joint]])
      effort = std::max(effort, 0.1 * loads[m->jnt_dofadr[j]]);
  // Two digits, rounded up.
  effort = std::max(1.5 * effort, 1e-3);
  const double unit = std::pow(10, std::floor(std::log10(effort)) - 1);
  const double rounded = unit * std::ceil(effort / unit);
  return {-rounded, rounded, "estimated from gravity and inertia, the model gives none", true};
}

}  // namespace

void random_pose(const mjModel* m, mjData* d, std::mt19937& random) {
  std::uniform_real_distribution<double> share(0, 1);
  for (int j = 0; j < m->njnt; ++j)
    if (m->jnt_type[j] == mjJNT_HINGE || (m->jnt_type[j] == mjJNT_SLIDE && m->jnt_limited[j])) {
      const double low = m->jnt_limited[j] ? m->jnt_range[2 * j] : -mjPI,
                   high = m->jnt_limited[j] ? m->jnt_range[2 * j + 1] : mjPI;
      d->qpos[m->jnt_qposadr[j]] = low + share(random) * (high - low);
    }
}

std::vector<int> actuators_of(const mjModel* m, int joint) {
  std::vector<int> actuators;
  for (int a = 0; a < mujoco::engine::actuator_count(m); ++a)
    if (on_joint(m, a) && m->actuator_trnid[2 * a] == joint) actuators.push_back(a);
  return actuators;
}

int tendon_actuator_of(const mjModel* m, int joint) {
  for (int a = 0; a < mujoco::engine::actuator_count(m); ++a) {
    if (m->actuator_trntype[a] != mjTRN_TENDON) continue;
    const int tendon = m->actuator_trnid[2 * a];
    for (int w = m->tendon_adr[tendon]; w < m->tendon_adr[tendon] + m->tendon_num[tendon]; ++w)
      if (m->wrap_type[w] == mjWRAP_JOINT && m->wrap_objid[w] == joint) return a;
  }
  return -1;
}

std::optional<Effort> actuator_effort(const mjModel* m, int joint) {
#if TRIBOTWIN_ENGINE_PLUGINS
  if (m->jnt_actfrclimited[joint])
    return Effort{m->jnt_actfrcrange[2 * joint], m->jnt_actfrcrange[2 * joint + 1], "actuatorfrcrange", false};
#endif
  for (const int a : actuators_of(m, joint)) {
    const auto range = [&](const mjtNum* r, double gain) {
      return std::pair{std::min(r[0] * gain, r[1] * gain), std::max(r[0] * gain, r[1] * gain)};
    };
    if (m->actuator_forcelimited[a]) {
      const auto [low, high] = range(m->actuator_forcerange + 2 * a, m->actuator_gear[6 * a]);
      return Effort{low, high, "forcerange", false};
    }
    if (const auto gain = motor_gain(m, a); gain && m->actuator_ctrllimited[a]) {
      const auto [low, high] = range(m->actuator_ctrlrange + 2 * a, *gain);
      return Effort{low, high, "ctrlrange of the motor", false};
    }
  }
  return {};
}

Loads loads_of(const mjModel* m) {
  const mujoco::DataPtr data(mj_makeData(m));
  mjData* d = data.get();
  std::mt19937 random(1);
  const auto nv = static_cast<std::size_t>(m->nv);
  Loads loads{std::vector<double>(nv), std::vector<double>(nv)};
  for (int pose = 0; pose < 200; ++pose) {
    random_pose(m, d, random);
    mj_forward(m, d);
    for (std::size_t dof = 0; dof < nv; ++dof) {
      const double acceleration = m->jnt_type[m->dof_jntid[dof]] == mjJNT_SLIDE ? 2 : 5;
      const double inertia = inertia_kg_m2(m, d, static_cast<int>(dof));
      double &gravity = loads.gravity_nm[dof], &moving = loads.moving_nm[dof];
      gravity = std::max<double>(gravity, std::abs(d->qfrc_bias[dof] - d->qfrc_passive[dof]));
      moving = std::max<double>(moving, std::abs(d->qfrc_bias[dof]) + acceleration * inertia);
    }
  }
  return loads;
}

Effort effort_of(const ForeignModel& foreign, int joint, const Loads& loads) {
  if (const auto effort = given(foreign, joint);
      effort && std::isfinite(effort->largest_nm()) && effort->largest_nm() > 0)
    return *effort;
  return estimated(foreign.model->get(), joint, loads.moving_nm);
}

Effort effort_given(double largest_nm) { return symmetric(largest_nm, "given"); }

}  // namespace tribotwin::twin
