#pragma once

#include <algorithm>
#include <optional>
#include <random>
#include <string>

#include <mujoco/mujoco.h>

#include <tribotwin/twin/gears/foreign_model.hpp>

/// How much torque the actuator of a joint can give.
namespace tribotwin::twin {

struct Effort {
  double low_nm = 0, high_nm = 0;  ///< joint side [Nm; N]
  std::string source;
  double largest_nm() const { return std::max(-low_nm, high_nm); }
};

/// Sets d's hinges and limited slides to places within their ranges, those without a range within a turn.
void random_pose(const mjModel* m, mjData* d, std::mt19937& random);

/// The actuators that act on a joint directly, in their order.
std::vector<int> actuators_of(const mjModel* m, int joint);
/// The actuator that moves a joint through a tendon, or -1.
int tendon_actuator_of(const mjModel* m, int joint);

/// The first that the model gives: actuatorfrcrange, forcerange, control range of a motor.
std::optional<Effort> actuator_effort(const mjModel* m, int joint);

/// The first that the model gives: effort of a URDF, actuatorfrcrange, forcerange, control range of a motor. Without
/// one: one and a half times the torque of gravity and of an acceleration of 5 rad/s^2 (2 m/s^2) over 200 poses within
/// the joint ranges, drawn with a fixed seed, and at least a tenth of the largest of such joints in the same robot.
Effort effort_of(const ForeignModel& foreign, int joint);

}  // namespace tribotwin::twin
