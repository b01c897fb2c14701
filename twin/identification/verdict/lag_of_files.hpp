#pragma once

#include <span>
#include <string>
#include <vector>

#include <tribotwin/twin/identification/rigid_body/robot_torque.hpp>

/// What recordings say of how late their torques are.
namespace tribotwin::twin::identification {

/// One line per joint whose files differ in their lag by more than a thousandth of chance: no one lag, nor none, is
/// right for all of them. `files`: names, in the order of FileLag::file.
std::vector<std::string> files_that_differ(const Regressor& regressor, std::span<const std::string> files,
                                           std::span<const FileLag> lags);

/// One line per file with joints whose torques are late, or early, by four sigma and a fifth of a sample more than
/// `motion` knows of (JointMotion::lag_s).
std::vector<std::string> late_torques(const Regressor& regressor, std::span<const std::string> files,
                                      std::span<const FileLag> lags, const JointMotion& motion);

}  // namespace tribotwin::twin::identification
