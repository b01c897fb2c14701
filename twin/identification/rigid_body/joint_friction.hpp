#pragma once

#include <span>
#include <string_view>
#include <vector>

#include <Eigen/Dense>

#include <tribotwin/plugins/friction/law.hpp>
#include <tribotwin/twin/identification/curves/basis.hpp>

/// Friction of one joint as a term of the robot's dynamics: value and exact derivatives by its parameters.
namespace tribotwin::twin::identification {

/// Coulomb and viscous friction with an offset of the torque, Fc sgn(v) + Fv v + offset [Nm; N], v of the joint: linear
/// in all parameters. Not a law of drives, as the offset is one of the sensor.
const friction::LawInfo& coulomb_viscous();

class JointFriction {
 public:
  /// Scales turn joint speeds [rad/s; m/s] into the law's and its torques into Nm; torque_max_nm turns loads into
  /// load_norm.
  struct Scales {
    double speed = 1, torque = 1, torque_max_nm = 1;
  };
  JointFriction(const friction::LawInfo& law, Scales scales);

  const friction::LawInfo& law() const { return *law_; }
  const Scales& scales() const { return scales_; }
  Eigen::Index size() const { return static_cast<Eigen::Index>(law_->parameters.size()); }

  /// Parameters that are a reference temperature of the law, which is a convention and not identifiable.
  std::vector<std::string_view> reference_temperatures() const;

  /// Torque [Nm; N] at a joint speed other than 0, load |tau_m| [Nm] and temperature [degC]; writes its size()
  /// derivatives by the parameters where `derivatives` is not null.
  double torque(std::span<const double> parameters, double speed, double load_nm, double temperature_degC,
                double* derivatives = nullptr) const;

 private:
  const friction::LawInfo* law_;
  Scales scales_;
  Placement place_;
};

}  // namespace tribotwin::twin::identification
