#pragma once

#include <span>
#include <string>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/mujoco/binding.hpp>
#include <tribotwin/plugins/transmission/hysteresis.hpp>

/// An elastic transmission tied to a fixed tendon, whose length is the torsion theta / u - q: coefficient 1/u on the
/// motor's joint, -1 on the arm's. An actuator applies -tau_g to that tendon, which acts on both joints.
namespace tribotwin::mujoco {

/// Name of the plugin in MJCF.
inline constexpr char spring_plugin_name[] = "tribotwin.hysteresis";
/// actdim of the MJCF vocabulary: x.
inline constexpr std::size_t spring_state_size = 1;

/// Beside x in mjData; doubles only. All zero is a fresh transmission.
struct SpringWorkspace {
  double step_open, step_time_s, torsion_begin_rad;
  double torsion_rad, torque_nm;  ///< of the last force, tau_g [arm side]
  double heat_J;                  ///< since reset
};
inline constexpr std::size_t spring_workspace_size = sizeof(SpringWorkspace) / sizeof(double);

/// Where a transmission is in a model. Immutable; shared by all mjData of the model.
struct Spring {
  transmission::Hysteresis hysteresis;
  Binding drive;  ///< supplies the temperature and receives the heat
  int actuator = -1, tendon = -1;
  int control = -1, force = -1;                    ///< addresses in mjData.ctrl and mjData.actuator_force
  int state_address = -1, workspace_address = -1;  ///< as those of Binding
  struct Part {
    int position;  ///< in mjData.qpos
    double coefficient;
  };
  std::vector<Part> torsion;

  double torsion_rad(const mjData* d) const {
    double sum = 0;
    for (const Part& p : torsion) sum += p.coefficient * d->qpos[p.position];
    return sum;
  }
};

/// A drive of a model, for `drive_of`.
struct NamedDrive {
  std::string instance;
  int joint;
};
/// Which drive has the temperature of the transmission at `actuator` and gets its heat: that on a joint of the tendon
/// whose instance has the name of the key `drive`, with or without a prefix, which attaching a model to another puts
/// before; without the key, any on the tendon; else that of the name anywhere. Fails where there is none or several.
Result<std::size_t> drive_of(const mjModel* m, const transmission::Hysteresis& hysteresis, int actuator,
                             std::span<const NamedDrive> drives);

/// Ties a transmission to actuator `actuator`. Fails when the actuator does not act on a fixed tendon, or the time step
/// is too long for the stiffness: the message names the element and the remedy. Addresses in mjData are the caller's.
Result<Spring> bind_spring(const mjModel* m, transmission::Hysteresis hysteresis, Binding drive, int actuator);

double& hysteretic_rad(mjData* d, const Spring& spring);  ///< x
double hysteretic_rad(const mjData* d, const Spring& spring);
SpringWorkspace& workspace(mjData* d, const Spring& spring);
const SpringWorkspace& workspace(const mjData* d, const Spring& spring);

/// tau_g [Nm, arm side] now; during later stages of Runge-Kutta along the way from the step's start.
double spring_torque(const mjModel* m, mjData* d, const Spring& spring);

/// After the step: updates x and adds the heat to the drive. Once per mj_step.
void book_spring(mjData* d, const Spring& spring);

}  // namespace tribotwin::mujoco
