#pragma once

#include <string>
#include <vector>

#include <tribotwin/twin/identification/rigid_body/joint_motion.hpp>
#include <tribotwin/twin/robot/regressor.hpp>

/// Whether a recording is one of the model's robot: what no header says, a unit or a joint's zero, shows in sizes and
/// in gravity. Findings are sentences for the user: models may be rough, and a fit needs none of their masses.
namespace tribotwin::twin::identification {

/// Torques far above or below what the joint's actuator can give; `effort` per joint [Nm; N], 0 where it is unknown.
std::vector<std::string> doubtful_sizes(const Regressor& regressor, const JointMotion& motion,
                                        const std::vector<double>& effort);

struct DoubtfulGravity {
  std::vector<std::string> findings;
  /// Whether all torques times -1 fit the model's gravity much better, and about as well as any other zero of a joint:
  /// of torques with the wrong sign, of a robot that hangs where the model stands, or of a joint half a turn away.
  bool opposite = false;
};

/// Torques that follow the gravity of the model's masses at another scale (amperes as Nm, mNm), with the other sign, or
/// at another zero of one joint, of a quarter of a turn or a half. By least squares on some samples in motion,
///
///   tau_j = s g_j(q) + c (rigid_j - g_j)(q, qd, qdd) + Fc sgn qd_j + Fv qd_j + offset,
///
/// where the rigid part explains 0.3 of the torque's variance beyond friction.
DoubtfulGravity doubtful_gravity(const Regressor& regressor, const JointMotion& motion);

}  // namespace tribotwin::twin::identification
