#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/robot/regressor.hpp>

/// Which motors turn with several joints: by the model's tendons, by a sum that a person writes, by a guess.
namespace tribotwin::twin {

/// The motors of actuators on fixed tendons of two or more joints; each has the coefficients of its tendon and the name
/// of its actuator, and belongs to the last of its joints that has no actuator and no such motor of its own. Empty
/// where the model has none. `robot`: the model's regressor, with motors or without.
std::vector<CoupledMotor> motors_on_tendons(const Regressor& robot);

/// "JOINT=SUM": the motor of JOINT turns with SUM, as in "joint_6 = joint_5 + joint_6" or "joint_6 = 0.5*joint_5 -
/// joint_6"; it is named motor_JOINT. Fails with `option`, the text and what would be right.
Result<CoupledMotor> coupled_motor(std::string_view option, const std::string& text, const Regressor& robot);

/// "joint_5 + joint_6": what a motor turns with.
std::string sum_of(const CoupledMotor& motor, const Regressor& robot);

/// Motors that wrists of robots may have: that of each of the last three joints turns with the joint before it too,
/// forward or backward. One of them at a time, neighbours of a chain only.
std::vector<CoupledMotor> conceivable_motors(const Regressor& robot);

}  // namespace tribotwin::twin
