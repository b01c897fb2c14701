#pragma once

#include <algorithm>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include <mujoco/mujoco.h>

#include <tribotwin/twin/gears/foreign_model.hpp>

/// How much torque the actuator of a joint can give.
namespace tribotwin::twin {

struct Effort {
  double low_nm = 0, high_nm = 0;  ///< joint side [Nm; N]
  std::string source;
  bool estimated = false;  ///< nobody gave it
  double largest_nm() const { return std::max(-low_nm, high_nm); }
};

/// Sets d's hinges and limited slides to places within their ranges, those without a range within a turn.
void random_pose(const mjModel* m, mjData* d, std::mt19937& random);

/// The actuators that act on a joint directly, in their order.
std::vector<int> actuators_of(const mjModel* m, int joint);
/// The actuator that moves a joint through a tendon, or -1.
int tendon_actuator_of(const mjModel* m, int joint);

/// The largest torque [Nm; N] that every dof needs over 200 poses within the joint ranges, drawn with a fixed seed.
struct Loads {
  std::vector<double> gravity_nm;  ///< springs included
  std::vector<double> moving_nm;   ///< gravity, and an acceleration of 5 rad/s^2 (2 m/s^2)
};
Loads loads_of(const mjModel* m);
/// The first that the model gives: actuatorfrcrange, forcerange, control range of a motor.
std::optional<Effort> actuator_effort(const mjModel* m, int joint);

/// The first that the model gives: effort of a URDF, actuatorfrcrange, forcerange, control range of a motor. Without
/// one it is `estimated`: one and a half times moving_nm, and at least a tenth of the largest of such joints in the
/// same robot.
Effort effort_of(const ForeignModel& foreign, int joint, const Loads& loads);
/// Of an actuator whose torque the user gives.
Effort effort_given(double largest_nm);

}  // namespace tribotwin::twin
