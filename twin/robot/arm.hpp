#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>

/// Properties of an arm beside its drives: joint names, gravity, payload.
namespace tribotwin::twin {

std::string joint_name(const mjModel* m, const mujoco::Binding& drive);
/// Of all drives, in their order.
std::vector<std::string> joint_names(const mujoco::Model& model);
/// Whether the drive's joint is a slide: its angles are lengths [m], its torques forces [N].
bool is_slide(const mjModel* m, const mujoco::Binding& drive);
/// The unit of a slide where the hinge's is `of_hinge`: N for Nm, m for rad, N s/m for Nm s/rad; else that of the
/// hinge.
std::string unit_of(std::string_view of_hinge, bool slide);
/// The drive of a joint. Fails with the name, the nearest name that exists, and all names.
Result<std::size_t> find_drive(const mujoco::Model& model, std::string_view joint);
/// The drive behind a transmission, and its joint turns per turn of the arm.
std::size_t drive_of(const mujoco::Model& model, const mujoco::Spring& spring);
double ratio_of(const mujoco::Spring& spring);
/// Place of the drive's joint in mjData.qpos.
int position_address(const mjModel* m, const mujoco::Binding& drive);

/// Maximum speed of a drive's joint [rad/s; m/s] from the <custom><numeric> joint_speed_max_rad_s, which has one number
/// per drive; nothing where the model does not have it.
std::optional<double> joint_speed_max_rad_s(const mujoco::Model& model, std::size_t drive);

/// Torque (force for a slide) that holds a dof against gravity at d's pose [Nm]; exact for trees of hinges and slides.
/// Needs the centres of mass of the current step (mj_comPos), no second pass of the dynamics.
double gravity_torque_nm(const mjModel* m, const mjData* d, int dof);

/// Inertia that a dof sees with all others at rest [kg m^2], rotors included, at d's pose (after mj_forward).
double inertia_kg_m2(const mjModel* m, const mjData* d, int dof);

/// A body carried at the flange: a point of mass with the inertia of a steel ball of that mass.
struct Payload {
  double mass_kg = 0;
  std::array<double, 3> com_m{};  ///< from the site "flange", or from the frame of the last driven body without one
};

/// The arm with a payload. Fails where the changed model cannot carry its drives.
Result<std::shared_ptr<const mujoco::Model>> with_payload(const mujoco::Model& arm, const Payload& payload);

}  // namespace tribotwin::twin
