#pragma once

#include <span>
#include <string>
#include <vector>

#include <tribotwin/twin/identification/rigid_body/dynamics.hpp>
#include <tribotwin/twin/identification/rigid_body/training_range.hpp>

/// What cannot be negative in a robot and is in its identified dynamics: the rotor inertia of a joint, and of linear
/// laws the friction at standstill, its slope at top speed and its growth with load.
namespace tribotwin::twin::identification {

struct Negative {
  std::string parameter;  ///< "joint2.Ia", "joint2.Fv", "joint2.Fc + Fs"
  std::string what;       ///< "viscous friction"
  double value = 0;       ///< below 0
  double sigma = 0;       ///< NaN where it was held
  std::string unit, cause;
  bool significant() const { return value < -2 * sigma; }
};

/// Of a joint that coupled motors turn, friction is what is left beside theirs: any sign. `ranges`: of the samples of
/// the fit, for the top speed.
std::vector<Negative> negative_values(const Regressor& regressor, const RobotFriction& friction, const DynamicsFit& fit,
                                      const std::vector<JointRange>& ranges);

/// Friction at standstill of all joints together, as distance from 0 [sigma]; below it friction would drive the motion.
/// The sum of every joint's over the root of their number: that of one joint may be uncertain where the sign of all is
/// not. A joint counts for 5 sigma at most, so that one alone does not stand for all. 0 where no law tells.
double pooled_friction(const Regressor& regressor, const RobotFriction& friction, const DynamicsFit& fit);

/// "viscous friction joint2.Fv is -0.12 +- 0.01 Nm s/rad: negative, 12 sigma below 0: ..."
std::vector<std::string> warnings_of(std::span<const Negative> all);

}  // namespace tribotwin::twin::identification
