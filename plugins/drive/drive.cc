#include <algorithm>
#include <cmath>

#include <tribotwin/plugins/drive/drive.hpp>

namespace tribotwin::drive {
namespace {

// Friction is evaluated at temperatures rounded to 61 uK, so that its coefficients stay cached for many steps and yet
// depend on nothing but the state: a restart from saved state repeats every bit.
constexpr double temperature_steps_per_K = 16384;

// At a limit of 0 the engine drops the constraint. This limit keeps it and is negligible as friction.
constexpr double smallest_limit_nm = 1e-12;

/// Bristles count as slipping from this share of the breakaway level on.
constexpr double slipping = 0.999;

struct Parts {
  double g, h;
};
/// The law's two parts, both >= 0.
Parts parts(const friction::Level& level) {
  return level.strengthening >= 0 ? Parts{level.weakening, level.strengthening} : Parts{level.total(), 0};
}

/// Factor of a pitted bearing on g, at the angle where the step began.
double ripple(const Drive& drive, const Workspace& s) {
  return s.faults.ripple == 0 ? 1 : 1 + s.faults.ripple * std::cos(drive.gear_ratio * s.q_begin_rad);
}

/// Maximum of |sigma0 z| at this load and temperature; g is the level at the present speed.
double breakaway(const Drive& drive, const Workspace& s, double g, double z) {
  return std::max(g, level(drive.law, {s.cache, false}, 0, s.load_used_nm / drive.torque_max_nm).weakening *
                         ripple(drive, s) * direction_factor(drive, z));
}

/// The level for a deflection in the direction of z, over that of motion w.
double towards(const Drive& drive, double z, double w) {
  return direction_factor(drive, z) / direction_factor(drive, w);
}

/// What the winding's temperature means for the step that begins.
void begin_winding(const Drive& drive, const State& state, Workspace& s) {
  const thermal::WindingState& winding = static_cast<const MotorState&>(state).winding;
  s.winding_rise_K = winding.rise_K;
  s.overload = winding.overload;
  s.winding_degC = winding_degC(drive, state);
  s.current_limit_A = drive.winding.current_limit_A(s.winding_degC, s.overload);
  s.hot_torque_loss = 1 - drive.winding.torque_share(s.winding_degC);
}

/// Power that the winding gives to the gear in a step with this motor torque [W].
double end_winding(const Drive& drive, double torque_nm, double dt_s, State& state, Workspace& s) {
  s.current_A = torque_nm / drive.torque_per_current_nm_A();
  const thermal::WindingHeat heat = thermal::step(drive.winding, s.winding_degC, s.current_A, state.rise.total_K(),
                                                  dt_s, static_cast<MotorState&>(state).winding);
  s.copper_loss_J += heat.copper_W * dt_s;
  s.winding_heat_J += heat.to_gear_W * dt_s;
  return heat.to_gear_W;
}

}  // namespace

double advance(const Bristles& b, double z0, double w, double g, double dt) {
  if (!(g > 0)) return w == 0 ? z0 : 0;
  const double end = g / b.sigma0;
  return z0 - (std::copysign(end, w) - z0) * std::expm1(-std::abs(w) * dt / end);
}

double LoadTable::operator()(double w, double load) const {
  if (values.empty()) return 0;
  struct Place {
    std::size_t below, above;
    double share;
  };
  const auto place = [](const std::vector<double>& axis, double x) -> Place {
    const auto above = static_cast<std::size_t>(std::ranges::upper_bound(axis, x) - axis.begin());
    if (above == 0) return {0, 0, 0};
    if (above == axis.size()) return {above - 1, above - 1, 0};
    return {above - 1, above, (x - axis[above - 1]) / (axis[above] - axis[above - 1])};
  };
  const Place row = place(speeds_rad_s, std::abs(w));
  const auto at = [&](double l) {
    const Place column = place(loads, l);
    const auto along = [&](std::size_t r) {
      const double* v = values.data() + r * loads.size();
      return std::lerp(v[column.below], v[column.above], column.share);
    };
    return std::lerp(along(row.below), along(row.above), row.share);
  };
  return w == 0 ? std::max(at(load), at(-load)) : at(w > 0 ? load : -load);
}

friction::Level level(const Drive& drive, const friction::AtTemperature& at, double w, double load_norm) {
  friction::Level level = friction::level(drive.law, at, w, load_norm);
  if (!drive.load_table.values.empty()) {
    const double total = std::max(level.total() + drive.load_table(w, load_norm), 0.0);
    level.weakening = std::max(level.weakening + drive.load_table(w, load_norm), 0.0);
    level.strengthening = total - level.weakening;
  }
  if (drive.asymmetry != 0) {
    level.weakening *= direction_factor(drive, w);
    level.strengthening *= direction_factor(drive, w);
  }
  return level;
}

double friction_nm(const Drive& drive, const friction::AtTemperature& at, double qd_rad_s, double load_norm) {
  return level(drive, at, qd_rad_s * drive.speed_scale(), load_norm).total() * drive.torque_scale_nm();
}

double temperature_degC(const Drive& drive, const State& state) {
  return drive.thermal.T_amb_degC + state.rise.total_K();
}

double winding_degC(const Drive& drive, const State& state) {
  if (!drive.winding.present()) return temperature_degC(drive, state);
  return drive.thermal.T_amb_degC + static_cast<const MotorState&>(state).winding.rise_K;
}

void set_winding(const Drive& drive, State& state, double winding_degC) {
  if (!drive.winding.present()) return;
  static_cast<MotorState&>(state).winding.rise_K = winding_degC - drive.thermal.T_amb_degC;
}

void set_temperature(const Drive& drive, State& state, double temperature_degC) {
  state.rise = thermal::steady_rise(drive.thermal, temperature_degC - drive.thermal.T_amb_degC);
}

void set_wear(Workspace& workspace, std::size_t index, double factor) {
  workspace.change[index] = factor - 1;
  workspace.worn = std::ranges::any_of(workspace.change, [](double change) { return change != 0; });
  workspace.cache_valid = 0;
}

void set_faults(Workspace& workspace, const Faults& faults) {
  workspace.faults = faults;
  workspace.cache_valid = 0;
}

friction::Law with_faults(const friction::Law& law, const Faults& faults) {
  return friction::scaled(law, 1 + faults.boundary, 1 + faults.stribeck_velocity, 1 + faults.viscous);
}

friction::Law current_law(const Drive& drive, const Workspace& workspace) {
  if (workspace.worn == 0) return with_faults(drive.law, workspace.faults);
  auto worn = drive.law.parameters;
  for (std::size_t i = 0; i < worn.size(); ++i) worn[i] *= 1 + workspace.change[i];
  return with_faults(friction::with_parameters(drive.law, {worn.data(), drive.law.info->parameters.size()}),
                     workspace.faults);
}

bool begun(const Drive& drive, const State& state, const Workspace& s, double time_s, double qd_rad_s, double q_rad) {
  return s.step_open != 0 && s.cache_valid != 0 && s.step_time_s == time_s && s.qd_begin_rad_s == qd_rad_s &&
         s.q_begin_rad == q_rad && s.load_used_nm == state.load_nm && s.rise_K == state.rise.total_K() &&
         s.limit_nm == s.gear_limit_nm + s.brake_engaged * drive.brake_torque_nm &&
         (drive.dynamics == Dynamics::none || s.deflection == static_cast<const BristleState&>(state).z) &&
         (!drive.winding.present() || (s.winding_rise_K == static_cast<const MotorState&>(state).winding.rise_K &&
                                       s.overload == static_cast<const MotorState&>(state).winding.overload));
}

double begin_step(const Drive& drive, const State& state, Workspace& s, double time_s, double qd_rad_s, double q_rad) {
  s.step_open = 1;
  s.step_time_s = time_s;
  s.qd_begin_rad_s = qd_rad_s;
  s.q_begin_rad = q_rad;

  if (drive.dynamics != Dynamics::none) s.deflection = static_cast<const BristleState&>(state).z;
  if (drive.winding.present()) begin_winding(drive, state, s);
  s.rise_K = state.rise.total_K();
  const double temperature =
      std::round(temperature_degC(drive, state) * temperature_steps_per_K) / temperature_steps_per_K;
  if (s.cache_valid == 0 || temperature != s.temperature_degC) {
    const friction::AtTemperature at = friction::at_temperature(current_law(drive, s), temperature);
    s.cache = at.coefficients;
    s.cache_outside = at.outside;
    s.cache_valid = 1;
    s.temperature_degC = temperature;
  }
  s.load_used_nm = state.load_nm;
  friction::Level at = level(drive, {s.cache, s.cache_outside != 0}, qd_rad_s * drive.speed_scale(),
                             state.load_nm / drive.torque_max_nm);
  at.weakening *= ripple(drive, s);
  s.outside = at.outside;
  double limit = at.total();
  s.applied_nm = 0;
  if (drive.dynamics == Dynamics::lugre) {
    const Bristles& b = drive.bristles;
    const auto [g, h] = parts(at);
    const double w = qd_rad_s * drive.speed_scale(), bent = static_cast<const BristleState&>(state).z,
                 max_z = breakaway(drive, s, g, bent) / b.sigma0, z = std::clamp(bent, -max_z, max_z);
    const double rate = g > 0 ? w - std::abs(w) * z * b.sigma0 / g : 0;
    s.applied_nm = (b.sigma0 * z + b.sigma1 * std::exp(-(w / b.vd) * (w / b.vd)) * rate) * drive.torque_scale_nm();
    limit = h;
  } else if (drive.dynamics == Dynamics::gear_loss) {
    const auto [g, h] = parts(at);
    const double z = std::clamp(static_cast<const BristleState&>(state).z, -1.0, 1.0);
    // Where both directions differ, the change from one to the other is as gradual as that of z.
    const double factor = 1 + drive.asymmetry * z, symmetric_g = g / direction_factor(drive, qd_rad_s);
    s.applied_nm = ((symmetric_g * drive.torque_scale_nm() + drive.gear_loss.mu_avg * std::abs(state.load_nm)) * z +
                    drive.gear_loss.mu_dif * state.load_nm * z * z) *
                   factor;
    limit = h;
  }
  if (s.faults.backlash_rad > 0 && std::abs(s.backlash_position) < 1) s.applied_nm = limit = 0;
  s.gear_limit_nm = std::max(limit * drive.torque_scale_nm(), smallest_limit_nm);
  s.limit_nm = s.gear_limit_nm + s.brake_engaged * drive.brake_torque_nm;
  return s.limit_nm;
}

bool holds(const Drive& drive, const State& state, const Workspace& s, double row_nm) {
  if (drive.dynamics == Dynamics::none) return std::abs(row_nm) < s.limit_nm * (1 - 1e-9);
  const double z = static_cast<const BristleState&>(state).z;
  if (drive.dynamics == Dynamics::gear_loss) return std::abs(z) < slipping;
  const double w = s.qd_begin_rad_s * drive.speed_scale();
  const auto at = level(drive, {s.cache, false}, w, s.load_used_nm / drive.torque_max_nm);
  return drive.bristles.sigma0 * std::abs(z) < slipping * parts(at).g * ripple(drive, s) * towards(drive, z, w);
}

void end_step(const Drive& drive, const thermal::Decay& decay, const Transmitted& t, double dt_s, State& state,
              Workspace& s) {
  s.step_open = 0;
  // Mean speed times torque is the kinetic energy that friction removed, up to rounding. It may be negative in a step
  // that reverses the motion and while bristles spring back; it is not clamped, so that the energy balance closes.
  const double mean_speed = 0.5 * (s.qd_begin_rad_s + t.qd_end_rad_s);
  s.friction_nm = gear_friction_nm(s, t.friction_nm);
  s.torque_nm = t.torque_nm;
  const double added_W = s.added_heat_J / dt_s;
  s.added_heat_J = 0;
  double power_W = s.friction_nm * mean_speed + added_W;
  if (drive.winding.present()) power_W += end_winding(drive, t.torque_nm, dt_s, state, s);
  s.friction_work_J += s.friction_nm * mean_speed * dt_s;

  if (s.temperature_held == 0) thermal::step(drive.thermal, decay, power_W, s.ambient_offset_K, state.rise);
  s.heat_J += power_W * dt_s;

  const double acceleration = (t.qd_end_rad_s - s.qd_begin_rad_s) / dt_s;
  const double load =
      delivered_nm(s) - (s.applied_nm + t.friction_nm + drive.offset_nm) - t.rotor_inertia_kg_m2 * acceleration;
  state.load_nm += (load - state.load_nm) * (drive.load_filter_s > 0 ? -std::expm1(-dt_s / drive.load_filter_s) : 1);

  // The step in which the flanks separate still has friction: a stuck joint creeps in the direction of the load, and
  // the flanks separate during that creep.
  if (s.faults.backlash_rad > 0)
    s.backlash_position =
        std::clamp(s.backlash_position + 2 * (t.q_end_rad - s.q_begin_rad) / s.faults.backlash_rad, -1.0, 1.0);

  s.steps_outside += s.outside;
  if (drive.dynamics == Dynamics::lugre) {
    double& z = static_cast<BristleState&>(state).z;
    const double w = (t.q_end_rad - s.q_begin_rad) / dt_s * drive.speed_scale();
    // g at the mean speed of the step, at the load and temperature of its start.
    const double g =
        parts(level(drive, {s.cache, false}, w, s.load_used_nm / drive.torque_max_nm)).g * ripple(drive, s);
    const double max_z = breakaway(drive, s, g, z) / drive.bristles.sigma0;
    z = std::clamp(advance(drive.bristles, std::clamp(z, -max_z, max_z), w, g, dt_s), -max_z, max_z);
    if (drive.bristles.sigma0 * std::abs(z) < slipping * g * towards(drive, z, w)) s.stuck_s += dt_s;
    return;
  }
  if (drive.dynamics == Dynamics::gear_loss) {
    double& z = static_cast<BristleState&>(state).z;
    const double w = (t.q_end_rad - s.q_begin_rad) / dt_s * drive.speed_scale();
    z = advance({.sigma0 = 1}, std::clamp(z, -1.0, 1.0), w / drive.gear_loss.length_rad, 1, dt_s);
    if (holds(drive, state, s, t.friction_nm)) s.stuck_s += dt_s;
    return;
  }
  if (holds(drive, state, s, t.friction_nm)) s.stuck_s += dt_s;
}

}  // namespace tribotwin::drive
