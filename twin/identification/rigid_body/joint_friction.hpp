#pragma once

#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/twin/identification/curves/basis.hpp>

/// Friction of one joint as a term of the robot's dynamics: value and exact derivatives by its parameters.
namespace tribotwin::twin::identification {

/// Coulomb and viscous friction, Fc sgn(v) + Fv v [Nm; N], v of the joint: linear in all parameters. Not a law of
/// drives.
const friction::LawInfo& coulomb_viscous();
/// The same with Coulomb friction that grows with the load l = |tau| / torque_max that the gear transmits,
/// (Fc + Fcl l) sgn(v) + Fv v; also linear and not a law of drives.
const friction::LawInfo& coulomb_viscous_load();
/// Both with friction that falls with speed, Fs e^-|v/vs|: linear, as vs is held and not fitted. A small vs is the
/// Stribeck effect, a large one a viscous slope that is not the same at all speeds.
const friction::LawInfo& coulomb_viscous_stribeck();
const friction::LawInfo& coulomb_viscous_load_stribeck();
/// The law of these with the same load term, with or without the term of vs; null for other laws.
const friction::LawInfo* with_stribeck(const friction::LawInfo& law);
/// The law of these with the same term of vs and with the load term; null for other laws.
const friction::LawInfo* with_load(const friction::LawInfo& law);

/// What a joint has beside its law f: tau = sgn(v) f(|v|, l, T) (1 + asymmetry sgn(v)) + offset + C cos q + S sin q.
struct Directional {
  bool offset = false;     ///< a torque [Nm; N] whatever the speed: of a spring, of gravity, of the sensor
  bool asymmetry = false;  ///< [-]: half the difference of forward and reverse friction per mean of both
  /// C and S [Nm], of a hinge at angle q: a spring, a counterweight, cables, a torque sensor that turns with the joint.
  bool position = false;

  Eigen::Index count() const { return offset + asymmetry + 2 * position; }
  bool operator==(const Directional&) const = default;
};
/// Their names, in the order in which they follow the law's parameters.
inline constexpr std::string_view offset_name = "offset", asymmetry_name = "asymmetry", cosine_name = "cos_q",
                                  sine_name = "sin_q";

class JointFriction {
 public:
  /// Scales turn joint speeds [rad/s; m/s] into the law's and its torques into Nm; torque_max_nm turns loads into
  /// load_norm.
  struct Scales {
    double speed = 1, torque = 1, torque_max_nm = 1;
  };
  JointFriction(const friction::LawInfo& law, Scales scales, Directional directional = {});

  const friction::LawInfo& law() const { return *law_; }
  const Scales& scales() const { return scales_; }
  Directional directional() const { return directional_; }
  /// The number of parameters: the law's, then offset, asymmetry, cosine and sine.
  Eigen::Index size() const { return law_size() + directional_.count(); }
  Eigen::Index law_size() const { return static_cast<Eigen::Index>(law_->parameters.size()); }
  const friction::Parameter& parameter(Eigen::Index index) const;
  /// Whether friction is linear in its parameters.
  bool linear() const { return is_linear(*law_) && !directional_.asymmetry; }
  static bool is_linear(const friction::LawInfo& law);
  /// Gives it the parts C cos q and S sin q.
  void depend_on_position() { directional_.position = true; }
  /// The vs [rad/s; m/s] of a law of with_stribeck; for other laws without effect.
  void hold_stribeck_speed(double vs) { stribeck_speed_ = vs; }
  /// The value of a parameter that is not fitted.
  std::optional<double> held(Eigen::Index parameter) const;
  /// The offset in `parameters`; 0 without one.
  double offset(std::span<const double> parameters) const {
    return directional_.offset ? parameters[static_cast<std::size_t>(law_size())] : 0;
  }

  /// Parameters that are a reference temperature of the law, which is a convention and not identifiable.
  std::vector<std::string_view> reference_temperatures() const;

  /// Torque [Nm; N] at a joint speed other than 0, load |tau_m| [Nm] and temperature [degC]; writes its size()
  /// derivatives by the parameters where `derivatives` is not null.
  double torque(std::span<const double> parameters, double speed, double load_nm, double temperature_degC,
                double* derivatives = nullptr) const {
    return filtered_torque(parameters, speed, speed < 0 ? -1 : 1, load_nm, temperature_degC, derivatives);
  }
  /// The same of a motion that passed a low-pass, with the filtered sign of its speed (JointMotion::direction): what
  /// friction is at standstill jumps with the direction, g(|v|, l, T) direction, and what grows from 0 with the speed,
  /// h(|v|, l, T) sgn(v), does not. Exact for Coulomb and viscous friction; for others as far as friction and load
  /// change little within a period of the cut-off.
  double filtered_torque(std::span<const double> parameters, double speed, double direction, double load_nm,
                         double temperature_degC, double* derivatives = nullptr) const;
  /// C cos q + S sin q [Nm] at a joint angle [rad], which `torque` has not; 0 without these parts.
  double position_torque(std::span<const double> parameters, double angle_rad, double* derivatives = nullptr) const;

 private:
  std::size_t cosine_at() const { return static_cast<std::size_t>(size()) - 2; }

  const friction::LawInfo* law_;
  Scales scales_;
  Directional directional_;
  double stribeck_speed_ = 0.1;
  Placement place_;
};

}  // namespace tribotwin::twin::identification
