#pragma once

#include <array>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/plugins/thermal/thermal.hpp>
#include <tribotwin/plugins/thermal/winding.hpp>

/// One joint drive: motor, gear, friction, heat. Engine-free; plugins/mujoco connects it to a simulation.
///
/// A step has two halves. `begin_step` turns speed, load and temperature into the friction limit that the engine's
/// joint-friction constraint gets (with bristles: into a torque); `end_step` takes the torque that the constraint
/// transmitted, turns it into heat and temperature, and stores the gear torque as the load of the next step. The load
/// is therefore one step late.
namespace tribotwin::drive {

/// How friction answers a change of speed.
enum class Dynamics {
  none,   ///< `static`: the law is the limit of the engine's joint-friction constraint
  lugre,  ///< bristles: their torque is applied to the joint, the constraint carries the viscous part h and the brake
  gear_loss,  ///< the baseline of google-deepmind/mujoco issue 3528, applied like lugre
};

/// LuGre over any static law of the table, with g its weakening and h its strengthening part (friction::level):
///
///   z' = w - sigma0 |w| z / g(w, l, T),   tau_f = sigma0 z + sigma1 e^-(w/vd)^2 z' + h(w, T)        RH380-N study (5),
///   (6)
///
/// w [rad/s] and z [rad] on the side of the law, torques in its unit. A negative h is added to g, so that neither part
/// drives the joint. z advances by the exact solution for constant w, the joint's displacement over the step divided by
/// dt. While friction sticks, z therefore equals the displacement up to rounding, and nothing creeps. sigma0 z is
/// limited to the breakaway level at the current load and temperature; the equation alone keeps this limit only while
/// both are constant.
struct Bristles {
  double sigma0 = 0;  ///< stiffness [unit of the law / rad]
  double sigma1 = 0;  ///< damping at w = 0 [unit of the law s / rad]
  double vd = 1;      ///< speed over which the damping fades [rad/s]
};

/// Gear losses proportional to the load tau [Nm, arm side], added to the friction g, h of a law if there is one:
///
///   z' = (w - |w| z) / length,   tau_f = (g + mu_avg |tau|) z + mu_dif tau z^2 + h        google-deepmind/mujoco issue
///   3528
///
/// z [-] changes from -1 to 1 over about `length` of motion [rad, the law's side]. |mu_dif| <= mu_avg, so that friction
/// opposes.
struct GearLoss {
  double mu_avg = 0, mu_dif = 0;  ///< mean loss per load; half the difference, driving minus driven
  double length_rad = 1;          ///< key `h`
};

/// Friction that depends on the load and its sign: tau_f,l of the RH380-N study (4), added to the weakening part g of
/// the law, so that it also acts at standstill (our choice). Bilinear interpolation, constant beyond the edges; empty:
/// none. The sign of the load is relative to the motion: a load above 0 is driven, one below 0 drives. At standstill
/// both signs are possible, and the larger value counts.
struct LoadTable {
  std::vector<double> speeds_rad_s;  ///< |w| on the law's side, ascending, >= 0
  std::vector<double> loads;         ///< load / torque_max_nm, ascending
  std::vector<double> values;  ///< [speeds x loads], unit of the law; may be below 0, the sum with the law never is
  /// `load_norm` with the sign of tau_m, `w` with the sign of the motion.
  double operator()(double w_rad_s, double load_norm) const;
};

/// z after dt [s] at constant w, from z0: relaxes towards (g / sigma0) sgn w with the rate sigma0 |w| / g. g >= 0.
double advance(const Bristles& bristles, double z0_rad, double w_rad_s, double g, double dt_s);

/// What the actuator's control is.
enum class Control {
  torque,    ///< motor torque [Nm, arm side]
  position,  ///< joint angle [rad] of a servo, as of MuJoCo's position actuator
};

/// Parameters: immutable, shared by all simulations and threads.
struct Drive {
  std::string name;
  friction::Law law;
  double torque_max_nm = 1;  ///< Bittencourt 2012's tau_max, arm side: unit of load and of normalised laws
  double gear_ratio = 1;     ///< motor turns per joint turn
  thermal::Model thermal;
  thermal::Winding winding;    ///< of the motor; none by default
  double brake_torque_nm = 0;  ///< holding brake, arm side
  double load_filter_s = 0;    ///< time constant of the load seen by friction; 0 = none
  Dynamics dynamics = Dynamics::none;
  Bristles bristles;   ///< of Dynamics::lugre
  GearLoss gear_loss;  ///< of Dynamics::gear_loss
  LoadTable load_table;
  Control control = Control::torque;
  double kp_nm_rad = 0, kv_nm_s_rad = 0;  ///< of Control::position
  /// The friction level is (1 + asymmetry) times the law's with positive motion of the joint, (1 - asymmetry) times
  /// with negative motion; -1..1, exclusive.
  double asymmetry = 0;
  /// Torque against positive motion that acts at every speed and at rest [Nm, arm side]: what a spring, a cable or an
  /// unknown weight takes. It is no heat, and no load of the gear.
  double offset_nm = 0;

  /// Law units to arm-side Nm.
  double torque_scale_nm() const { return law.info->normalised ? torque_max_nm : 1; }
  /// Joint speed to the law's speed.
  double speed_scale() const { return law.info->side == friction::Side::motor ? gear_ratio : 1; }
  /// Torque per current that a controller assumes: arm side, of the winding at its reference temperature [Nm/A].
  double torque_per_current_nm_A() const { return gear_ratio * winding.torque_constant_nm_A; }
};

/// The state that determines a drive's future. On 3.x it lies in mjData's activations, so that resets, copies and
/// keyframes include it. All zero: ambient temperature, no load.
struct State {
  thermal::Rise rise;  ///< lubricant above T_amb [K]
  double load_nm = 0;  ///< gear torque of the last step, arm side, signed
};

/// The state of a drive with bristles. For such a drive, pass one wherever the functions below take a State.
struct BristleState : State {
  double z = 0;  ///< lugre: bristle deflection [rad, side of the law]; gear_loss: z [-]
};

/// The state of a drive with a winding, with or without bristles; likewise.
struct MotorState : BristleState {
  thermal::WindingState winding;
};

/// Faults of a drive as mechanisms that act in a step; all zero: a healthy drive. Named faults: fault.hpp.
struct Faults {
  double boundary;           ///< relative change of g, the friction of surfaces in contact (Fc, Fs)
  double stribeck_velocity;  ///< relative change of the Stribeck velocities
  double viscous;            ///< relative change of h, the lubricant's friction
  /// Pitted bearing, on the ring that turns with the motor: g (1 + ripple cos(gear_ratio q)); 0..1, so that friction
  /// never pushes.
  double ripple;
  /// Share of the torque computed from the current that the motor does not deliver.
  double torque_loss;
  /// Backlash [rad, arm side]: after a reversal the gear transmits no friction until the gap is crossed. Rotor and arm
  /// are one body here: the arm crosses the gap without an impact, and no load keeps the flanks in contact.
  double backlash_rad;
};

/// Inputs, cache and outputs of a drive, stored beside State in mjData. All zero: a healthy drive with its brake
/// released. Doubles only, because it is stored in an array of mjtNum.
struct Workspace {
  // inputs, set from outside between steps
  double ambient_offset_K;                  ///< ambient temperature above T_amb
  double temperature_held;                  ///< not 0: the thermal model is off and the temperature stays as set
  double brake_engaged;                     ///< 0..1 of brake_torque_nm
  double worn;                              ///< not 0: `change` applies
  double change[friction::max_parameters];  ///< relative change of each law parameter; wear factor - 1

  Faults faults;             ///< `set_faults` writes them
  double backlash_position;  ///< position within the backlash, -1..1; the flanks touch at both ends

  double added_heat_J;  ///< heat from other parts of the gear; the next end_step adds it

  // cache of the law at one temperature: a pure function of that temperature, `change` and `faults`
  double cache_valid;
  double cache_outside;
  friction::Coefficients cache;

  // the step under way
  double step_open;    ///< not 0 between begin_step and end_step
  double step_time_s;  ///< engine time when the step began
  double qd_begin_rad_s;
  double gear_limit_nm, limit_nm;  ///< friction limit without and with brake, arm side; with bristles that of h alone
  double q_begin_rad;
  double applied_nm;                ///< torque of the bristles, arm side, positive with motion; 0 without bristles
  double rise_K;                    ///< when the step began
  double deflection;                ///< of the bristles when the step began
  double winding_rise_K, overload;  ///< when the step began; as the next three 0 without a winding
  double winding_degC;
  double current_limit_A;
  double hot_torque_loss;  ///< share of the torque computed from the current that the warm magnets do not deliver
  double passive_nm;       ///< this drive's share of qfrc_passive on engines without plugins

  // outputs of the last finished step
  double temperature_degC;  ///< at which friction was evaluated, a multiple of 2^-14 K
  double load_used_nm;      ///< load at which friction was evaluated, arm side, signed
  double friction_nm;       ///< transmitted gear friction, arm side, positive with motion, without Drive::offset_nm
  double torque_nm;  ///< motor torque, arm side, as computed from the current: the value that a controller assumes
  double outside;    ///< not 0: an input lay outside the law's range
  double current_A;  ///< of the motor; 0 without a winding

  // totals since reset
  double friction_work_J, heat_J;        ///< heat = friction work + what `added_heat_J` brought + winding_heat_J
  double copper_loss_J, winding_heat_J;  ///< made in the winding; of it, what has flowed to the gear
  double steps_outside;
  double stuck_s;  ///< time in which friction held the joint
};
inline constexpr std::size_t workspace_size = sizeof(Workspace) / sizeof(double);
/// actdim of the MJCF vocabulary: 3, with bristles 4, with a winding 6.
inline std::size_t state_size(const Drive& drive) {
  static_assert(sizeof(State) == 3 * sizeof(double) && sizeof(BristleState) == 4 * sizeof(double) &&
                sizeof(MotorState) == 6 * sizeof(double));
  if (drive.winding.present()) return 6;
  return drive.dynamics == Dynamics::none ? 3 : 4;
}

/// Factor of the friction level for motion in the direction of `w`. At rest that of the stronger direction; as soon as
/// the soft constraint moves in the direction of its force, by far less than a creep that counts, it is the right one.
inline double direction_factor(const Drive& drive, double w) {
  const double a = drive.asymmetry;
  return 1 + (w > 0 ? a : w < 0 || a < 0 ? -a : a);
}

/// Friction level of the drive, law, load table and asymmetry, at the speed w [rad/s, the law's side]. Unit of the law.
/// The load has the sign of tau_m.
friction::Level level(const Drive& drive, const friction::AtTemperature& at, double w_rad_s, double load_norm);

/// The same at a joint speed [rad/s], as a torque of the arm side [Nm].
double friction_nm(const Drive& drive, const friction::AtTemperature& at, double qd_rad_s, double load_norm);

/// Lubricant temperature [degC].
double temperature_degC(const Drive& drive, const State& state);

/// Winding temperature [degC]; the lubricant's without a winding.
double winding_degC(const Drive& drive, const State& state);
/// Sets it; nothing without a winding.
void set_winding(const Drive& drive, State& state, double winding_degC);

/// Sets the lubricant temperature; the thermal model continues from there unless `workspace.temperature_held`. A
/// winding keeps its own.
void set_temperature(const Drive& drive, State& state, double temperature_degC);

/// Multiplies law parameter `index` by `factor` (>= 0; 1 restores it).
void set_wear(Workspace& workspace, std::size_t index, double factor);

/// Replaces the faults of this simulation.
void set_faults(Workspace& workspace, const Faults& faults);

/// Motor torque that acted in the last finished step [Nm, arm side].
inline double delivered_nm(const Workspace& s) {
  return (1 - s.faults.torque_loss) * (1 - s.hot_torque_loss) * s.torque_nm;
}

/// A motor torque within the current limit of the step under way [Nm, arm side]; any without a winding.
inline double within_current_limit(const Drive& drive, const Workspace& s, double torque_nm) {
  if (!drive.winding.present()) return torque_nm;
  const double most_nm = drive.torque_per_current_nm_A() * s.current_limit_A;
  return torque_nm > most_nm ? most_nm : torque_nm < -most_nm ? -most_nm : torque_nm;
}

/// A law with the faults that act at every angle: all but ripple and backlash.
friction::Law with_faults(const friction::Law& law, const Faults& faults);

/// The law as worn and faulty in this simulation.
friction::Law current_law(const Drive& drive, const Workspace& workspace);

/// Starts a step at engine time time_s from joint angle q [rad] and speed qd [rad/s] and returns the limit of the
/// joint-friction constraint [Nm], > 0. With bristles, the caller also applies `workspace.applied_nm` against the
/// joint. Calling it again before `end_step` restarts the step.
double begin_step(const Drive& drive, const State& state, Workspace& workspace, double time_s, double qd_rad_s,
                  double q_rad = 0);

/// Whether begin_step with these arguments would change nothing, because it was the last call and no input has changed.
bool begun(const Drive& drive, const State& state, const Workspace& workspace, double time_s, double qd_rad_s,
           double q_rad);

/// Whether time_s is a later stage of the step under way (Runge-Kutta). The limit from the step's start then stays
/// valid: friction is held over the step (zero-order hold), so that the torque counted as heat is the torque that
/// acted. `AnyWorkspace`: Workspace, or that of another element, with its step_open and step_time_s.
template <typename AnyWorkspace>
bool within_step(const AnyWorkspace& s, double time_s, double dt_s) {
  return s.step_open != 0 && time_s > s.step_time_s && time_s <= s.step_time_s + dt_s * (1 + 1e-9);
}

/// Friction of the gear without brake and offset [Nm, arm side, positive with motion], while the constraint transmits
/// row_nm.
inline double gear_friction_nm(const Workspace& s, double row_nm) {
  return s.applied_nm + (s.limit_nm > 0 ? row_nm * (s.gear_limit_nm / s.limit_nm) : 0);
}

/// Whether friction or the brake holds the joint in the step under way, in which the constraint transmits row_nm.
bool holds(const Drive& drive, const State& state, const Workspace& workspace, double row_nm);

/// What a finished step did.
struct Transmitted {
  double friction_nm;  ///< of the constraint, arm side, positive when it opposes positive motion
  double torque_nm;    ///< motor torque, arm side, as computed from its current
  double qd_end_rad_s, q_end_rad;
  double rotor_inertia_kg_m2;  ///< arm side (armature)
};
void end_step(const Drive& drive, const thermal::Decay& decay, const Transmitted& transmitted, double dt_s,
              State& state, Workspace& workspace);

}  // namespace tribotwin::drive
