#pragma once

#include <Eigen/Dense>

#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/identification/rigid_body/robot_torque.hpp>
#include <tribotwin/twin/robot/excitation.hpp>

namespace tribotwin::twin::identification {

/// rms torque [Nm; N] that the model's bodies need in each joint at random states within the limits.
Eigen::VectorXd typical_torque(Regressor regressor, const MotionLimits& limits);

/// Numbers of the law about which a design may linearise, per rotor: those of the model's drive where it has this law;
/// else the law fitted to the drive's friction, or without a drive to friction that is typical of the joint's torque
/// (`torque_nm`: a tenth of it, half more when slow, twice at full speed). Offset and asymmetry are 0.
/// ErrorKind::work where the law cannot take that shape.
Result<std::vector<std::vector<double>>> typical_friction(const mujoco::Model& model, const Regressor& regressor,
                                                          const RobotFriction& friction, const MotionLimits& limits,
                                                          const Eigen::VectorXd& torque_nm);

}  // namespace tribotwin::twin::identification
