#pragma once

#include <string>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/plugins/mujoco/loader.hpp>
#include <tribotwin/twin/identification/rigid_body/robot_recording.hpp>

namespace tribotwin::twin::identification {

/// What pushes the tool from outside, without a sensor (paper 3, Fig. 8): force [N] and torque [Nm] at a site of the
/// model, world axes, 6 x samples, that explain best in the least-squares sense what motors give beyond `predicted`
/// (joints x samples), J^T F = predicted - measured. Torques of joints that rest tell nothing, as friction holds them:
/// NaN where the others leave a part of the six open. With the bandwidth of the recording's filter, for recordings;
/// control/external_torque.hpp is for control loops. Fails where the model has no such site.
Result<Eigen::MatrixXd> external_wrench(const mujoco::Model& model, const std::string& site, const JointMotion& motion,
                                        const Eigen::MatrixXd& predicted);

}  // namespace tribotwin::twin::identification
