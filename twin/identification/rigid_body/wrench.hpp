#pragma once

#include <string>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/identification/rigid_body/joint_motion.hpp>

namespace tribotwin::twin::identification {

/// External force [N] and torque [Nm] at a site of the model without a sensor (Hao 2021, Fig. 8): world axes, 6 x
/// samples, the least-squares solution of J^T F = predicted - measured torque. `predicted`: joints x samples. Joints at
/// rest do not count, as friction holds them; NaN where the moving ones leave a component undetermined. For recordings,
/// with the bandwidth of their filter; control/external_torque.hpp is for control loops. ErrorKind::input where the
/// model has no such site.
Result<Eigen::MatrixXd> external_wrench(const mujoco::Model& model, const std::string& site, const JointMotion& motion,
                                        const Eigen::MatrixXd& predicted);

}  // namespace tribotwin::twin::identification
