#pragma once

#include <array>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/twin/identification/rigid_body/joint_motion.hpp>

/// Where identified dynamics were seen to hold: the span of every joint's motion in the samples of the fit. A
/// prediction outside is an extrapolation of the law of friction, or of bodies whose parameters these samples did not
/// tell.
namespace tribotwin::twin::identification {

struct Span {
  double low = std::numeric_limits<double>::infinity(), high = -std::numeric_limits<double>::infinity();
  bool known() const { return low <= high; }
};

/// Of one joint: [rad; m], [rad/s; m/s], [rad/s^2; m/s^2], magnitude [Nm; N] and [degC]. Position and acceleration of
/// the samples in which any joint moves, as they act on all; speed, load and temperature while the joint itself does.
enum class Ranged : std::size_t { position, speed, acceleration, load, temperature };
struct RangedInfo {
  std::string_view name, unit;  ///< unit of a hinge
};
inline constexpr std::array<RangedInfo, 5> ranged_infos = {
    {{"position", "rad"}, {"speed", "rad/s"}, {"acceleration", "rad/s^2"}, {"load", "Nm"}, {"temperature", "degC"}}};
using JointRange = std::array<Span, ranged_infos.size()>;

/// Per joint; spans that are not known where nothing moves. `gear_load`: joints x samples, as gear_load gives it.
/// `with_temperature`: the motion's temperatures were recorded or estimated.
std::vector<JointRange> ranges_of(const JointMotion& motion, const Eigen::MatrixXd& gear_load, bool with_temperature);

/// What of a motion lies outside of the span of the training by more than a tenth of its width (of temperature: 2 K at
/// least).
struct Beyond {
  Ranged what = Ranged::position;
  Span trained;
  double furthest = 0;
  double share = 0;  ///< of the motion's samples

  const RangedInfo& info() const { return ranged_infos[static_cast<std::size_t>(what)]; }
};

/// Per joint, for every quantity whose span is known; `share` 0 where the motion stays inside.
std::vector<std::vector<Beyond>> beyond(const std::vector<JointRange>& trained, const JointMotion& motion,
                                        const Eigen::MatrixXd& gear_load, bool with_temperature);

/// Joints x samples: the joint moves, and no quantity of which `beyond` counts the share is outside in this sample:
/// neither of its own nor position and acceleration of another joint. False throughout where nothing is known of the
/// training.
Eigen::Matrix<bool, Eigen::Dynamic, Eigen::Dynamic> in_training(const std::vector<JointRange>& trained,
                                                                const JointMotion& motion,
                                                                const Eigen::MatrixXd& gear_load,
                                                                bool with_temperature);

/// Joints x samples: position, speed and acceleration of the joint itself are in the span of the training, without the
/// margin of `beyond`; a speed between the span and rest is. True where a span is not known; false throughout where
/// nothing is known of the training.
Eigen::Matrix<bool, Eigen::Dynamic, Eigen::Dynamic> motion_in_span(const std::vector<JointRange>& trained,
                                                                   const JointMotion& motion);

/// Whether the motion of `other` acts on the torque of `joint`: both move a body or turn a rotor, as joints along one
/// chain do. True of a joint and itself.
bool loads(const Regressor& regressor, Eigen::Index other, Eigen::Index joint);

/// "joint elbow leaves the training: speed reaches 3.1 rad/s (-1.2 .. 1.4 in training; 12 % of samples outside)"; empty
/// where it stays inside.
std::string beyond_training(const std::string& joint, bool slide, const std::vector<Beyond>& all);

}  // namespace tribotwin::twin::identification
