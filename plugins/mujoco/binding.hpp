#pragma once

#include <string>
#include <vector>

#include <mujoco/mujoco.h>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/plugins/friction/error.hpp>

/// A drive tied to one joint of an engine model, and the two half steps on mjData that both engine versions share.
namespace tribotwin::mujoco {

/// Name of the plugin in MJCF.
inline constexpr char plugin_name[] = "tribotwin.drive";

/// Where a drive is in a model. Immutable; shared by all mjData of the model.
struct Binding {
  drive::Drive drive;
  thermal::Decay decay;                                    ///< for the model's time step
  int actuator = -1, joint = -1, dof = -1, position = -1;  ///< position: in mjData.qpos
  int control = -1, force = -1;                            ///< addresses in mjData.ctrl and mjData.actuator_force
  int row_hint = 0;                                        ///< among the friction rows
  double gear = 1;                                         ///< joint torque per actuator force
  int state_address = -1;                                  ///< in mjData.act (3.x) or mjData.userdata (2.2.2)
  int workspace_address = -1;                              ///< in mjData.plugin_state (3.x) or mjData.userdata (2.2.2)

  /// Joint speed [rad/s; m/s for a slide].
  double speed(const mjData* d) const { return d->qvel[dof]; }
  /// Joint angle [rad; m for a slide].
  double angle(const mjData* d) const { return d->qpos[position]; }
};

/// The actdim that the actuator of a drive needs and why, for messages.
std::string actdim_message(const drive::Drive& drive);

/// Solver settings (mjtSolver) at which a stuck joint does not creep.
double needed_tolerance(int solver);
int needed_iterations(int solver);

/// Ties a drive to actuator `actuator`. Fails when the actuator does not drive a hinge or slide joint, or the joint,
/// the solver or the time step could not carry friction faithfully: the message names the element and the remedy.
Result<Binding> bind(const mjModel* m, drive::Drive drive, int actuator);

/// Whether the model's options (solver, time step, integrator, flags) carry the friction of a bound drive faithfully.
/// `bind` calls it; call it again where options may have changed since.
Result<void> check_options(const mjModel* m, const Binding& binding);

/// State of a drive in d; of a drive with bristles the state is a drive::BristleState. Changing it between steps is
/// allowed; see drive.hpp for what is input.
drive::State& state(mjData* d, const Binding& binding);
drive::Workspace& workspace(mjData* d, const Binding& binding);
const drive::State& state(const mjData* d, const Binding& binding);
const drive::Workspace& workspace(const mjData* d, const Binding& binding);

/// The actuator force that the control commands, within its range and the drive's current limit, as computed from the
/// motor's current.
double commanded_force(const mjModel* m, const mjData* d, const Binding& binding);

/// Where in mj_forward or mj_inverse the engine asks for friction.
enum class Stage {
  passive,    ///< at the end of mj_passive, which has just computed qfrc_passive afresh
  actuation,  ///< in mj_fwdActuation; mj_forwardSkip and the engine's finite differences repeat it alone
};

/// Before the solver runs: writes the friction limit into the joint's constraint row, and the torque of the bristles,
/// the offset and the missing torque of a weak motor into qfrc_passive. Both hosts call it at both stages, so that
/// inverse dynamics includes the law and a change of activation or control between the stages counts. Repeated calls
/// have the effect of one. `passive_nm` stores this drive's share of qfrc_passive.
void limit_friction(const mjModel* m, mjData* d, const Binding& binding, Stage stage, double& passive_nm);

/// After the step: heat, temperature, load. Once per mj_step.
void book_friction(const mjModel* m, mjData* d, const Binding& binding);

/// Friction level [Nm, arm side], without the offset, at joint speed [rad/s], load [-] and temperature [degC]. Its sign
/// matters where the directions differ.
double friction_nm(const drive::Drive& drive, double qd_rad_s, double load_norm, double temperature_degC);
/// What friction and offset take from the motor torque [Nm, arm side], positive with motion. At rest the offset alone.
double resistance_nm(const drive::Drive& drive, double qd_rad_s, double load_norm, double temperature_degC);

}  // namespace tribotwin::mujoco
