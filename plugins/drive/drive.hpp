#pragma once

#include <array>
#include <string>

#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/plugins/thermal/thermal.hpp>

/// One joint drive: motor, gear, friction, heat. Engine-free; plugins/mujoco connects it to a simulation.
///
/// A step has two halves. `begin_step` turns speed, load and temperature into the friction limit that the engine's
/// joint-friction constraint gets; `end_step` takes the torque that constraint really transmitted, turns it into heat
/// and temperature, and keeps the gear torque as the load of the next step (physics.md section 6: one step late).
namespace tribotwin::drive {

/// Parameters: immutable, shared by all simulations and threads.
struct Drive {
  std::string name;
  friction::Law law;
  double torque_max_nm = 1;      ///< P1's tau_max, arm side: unit of load and of normalised laws
  double gear_ratio = 1;         ///< motor turns per joint turn
  thermal::Model thermal;
  double brake_torque_nm = 0;    ///< holding brake, arm side
  double load_filter_s = 0;      ///< time constant of the load seen by friction; 0 = none

  /// Law units to arm-side Nm.
  double torque_scale_nm() const { return law.info->normalised ? torque_max_nm : 1; }
  /// Joint speed to the law's speed.
  double speed_scale() const { return law.info->side == friction::Side::motor ? gear_ratio : 1; }
};

/// What a drive must remember for its future: in mjData's activations on 3.x, so that resets, copies and keyframes
/// carry it. All zero is a drive at ambient temperature without load.
struct Memory {
  thermal::Rise rise;            ///< lubricant above T_amb [K]
  double load_nm = 0;            ///< gear torque of the last step, arm side, signed
};

/// Inputs, cache and outputs of a drive, beside Memory in mjData. All zero is a healthy drive with its brake released.
/// Doubles only: it lives in an array of mjtNum.
struct Scratch {
  // inputs, set from outside between steps
  double ambient_offset_K;       ///< ambient temperature above T_amb
  double temperature_held;       ///< not 0: the thermal model rests, the temperature is what was set
  double brake_engaged;          ///< 0..1 of brake_torque_nm
  double worn;                   ///< not 0: `change` applies
  double change[friction::max_parameters];  ///< relative change of each law parameter; wear factor - 1

  // cache of the law at one temperature, a pure function of it and of `change`
  double cache_valid;
  double cache_outside;
  friction::Coefficients cache;

  // the step under way
  double step_open;              ///< not 0 between begin_step and end_step
  double step_time_s;            ///< engine time when the step began
  double qd_begin_rad_s;
  double gear_limit_nm, limit_nm;  ///< friction limit without and with brake, arm side

  // outputs of the last finished step
  double temperature_degC;       ///< at which friction was evaluated, a multiple of 2^-14 K
  double load_used_nm;           ///< load at which friction was evaluated, arm side, signed
  double friction_nm;            ///< transmitted gear friction, arm side, positive with motion
  double torque_nm;              ///< motor torque, arm side
  double outside;                ///< not 0: an input lay outside the law's range

  // totals since reset
  double friction_work_J, heat_J;
  double steps_outside;
  double stuck_s;                ///< time in which friction held the joint
};
inline constexpr std::size_t scratch_size = sizeof(Scratch) / sizeof(double);
inline constexpr std::size_t memory_size = sizeof(Memory) / sizeof(double);
static_assert(memory_size == 3, "actdim of the MJCF vocabulary");

/// Lubricant temperature [degC].
double temperature_degC(const Drive& drive, const Memory& memory);

/// Sets the lubricant temperature; the thermal model goes on from there unless `scratch.temperature_held`.
void set_temperature(const Drive& drive, Memory& memory, double temperature_degC);

/// Multiplies law parameter `index` by `factor` (>= 0; 1 restores it).
void set_wear(Scratch& scratch, std::size_t index, double factor);

/// The law as worn in this simulation.
friction::Law current_law(const Drive& drive, const Scratch& scratch);

/// Starts a step at engine time time_s from joint speed qd [rad/s] and returns the limit of the joint-friction
/// constraint [Nm], > 0. Calling it again before `end_step` restarts the step.
double begin_step(const Drive& drive, const Memory& memory, Scratch& scratch, double time_s, double qd_rad_s);

/// Whether time_s is a later stage of the step under way (Runge-Kutta). The limit of the step's start then stands:
/// friction is a zero-order hold over the step, so that the torque booked as heat is the torque that acted.
inline bool within_step(const Scratch& s, double time_s, double dt_s) {
  return s.step_open != 0 && time_s > s.step_time_s && time_s <= s.step_time_s + dt_s * (1 + 1e-9);
}

/// What a finished step did.
struct Transmitted {
  double friction_nm;            ///< of the constraint, arm side, positive when it opposes positive motion
  double torque_nm;              ///< motor torque, arm side
  double qd_end_rad_s;
  double rotor_inertia_kg_m2;    ///< arm side (armature)
};
void end_step(const Drive& drive, const thermal::Decay& decay, const Transmitted& transmitted, double dt_s,
              Memory& memory, Scratch& scratch);

}  // namespace tribotwin::drive
