#pragma once

#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>

/// The rule of identifiability for a robot's identified dynamics.
namespace tribotwin::twin::identification {

/// Of every joint's friction parameters, named JOINT.Fc; `gear_load` (joints x samples) as gear_load gives it.
std::vector<Lacking> lacking_friction(const Regressor& regressor, const RobotFriction& friction,
                                      const JointMotion& motion, const Eigen::MatrixXd& gear_load,
                                      const DynamicsFit& fit);

/// Base parameters that were estimated, and those of them whose 95 % interval is wider than their value.
struct BaseCount {
  std::size_t estimated = 0, wide = 0, held = 0;
};
BaseCount count_base(const DynamicsFit& fit);

}  // namespace tribotwin::twin::identification
