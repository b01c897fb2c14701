#pragma once

#include <cstdint>
#include <string_view>
#include <utility>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/plugins/transmission/hysteresis.hpp>
#include <tribotwin/twin/control/momentum_observer.hpp>

/// Feed-forward of the torsion of an elastic, hysteretic gear from motor-side signals (RH380-N study, section 5.2). No
/// sensor behind the gear is used: motor torque, less friction, less what accelerates the rotor, is the gear's torque;
/// the inverted hysteresis makes a torsion of it, and the set point gets that torsion on top.
namespace tribotwin::twin {

/// The source of the momentum observer's friction.
enum class Compensation {
  none,      ///< the set point stays as it is
  static_,   ///< the study's reference method [8]: static friction curve of one temperature, no load, no dead zone
  proposed,  ///< LuGre observer with load and temperature, dead zone
};
/// The names "none", "static" and "proposed".
std::string_view name_of(Compensation compensation);

/// A controller's model of its drive and gear.
struct JointModel {
  drive::Drive drive;
  transmission::Hysteresis transmission;
  double inertia_kg_m2 = 0;  ///< of the rotor, on the side of the drive's joint
  double ratio = 1;          ///< joint turns of the drive per turn of the arm

  /// Every number of law, bristles, table, stiffness, shape and inertia times 1 + `relative` N(0, 1): the error of an
  /// identification, so that the controller does not know the exact plant. w stays below 1 and n at or above 1;
  /// friction stays a valid law.
  JointModel misjudged(double relative, std::uint64_t seed) const;
};

/// The inverse of a transmission: torsion from torque, integrated step by step like the transmission itself.
class HysteresisInverse {
 public:
  explicit HysteresisInverse(transmission::Hysteresis hysteresis) : h_(std::move(hysteresis)) {}
  /// Torsion [rad] at which the transmission, coming from its last torsion, has this torque [Nm, arm side].
  double update(double torque_nm, double temperature_degC);
  double torsion_rad() const { return torsion_rad_; }
  void state(StateNumbers& s) { s(torsion_rad_), s(hysteretic_rad_); }

 private:
  transmission::Hysteresis h_;
  double torsion_rad_ = 0, hysteretic_rad_ = 0;
};

struct CompensatorOptions {
  Compensation compensation = Compensation::proposed;
  double observer_gain_1_s = 60;           ///< K_o of (8)
  double friction_gain_rad_nm_s = 0;       ///< k_f of (12b)
  double dead_zone_rad = 0;                ///< half width, arm side; for `proposed`
  double reference_temperature_degC = 20;  ///< of the static curve and its spring
};

/// One joint's compensation. Call `update` once per control period, in order.
class Compensator {
 public:
  Compensator(JointModel model, const CompensatorOptions& options);

  struct Input {
    double torque_nm;               ///< of the motor since the last call, on the side of the drive's joint
    double angle_rad, speed_rad_s;  ///< measured, the drive's joint
    double resolution_rad;          ///< of the angle
    double acceleration_rad_s2;     ///< set point, the drive's joint: the measured one is too coarse
    double temperature_degC;        ///< measured, lubricant
  };
  /// Torsion to add to the arm's set point [rad].
  double update(const Input& input, double time_s, double dt_s);

  double friction_nm() const { return friction_nm_; }            ///< on the side of the drive's joint, signed
  double gear_torque_nm() const;                                 ///< arm side
  double torsion_rad() const { return inverse_.torsion_rad(); }  ///< as estimated, before the dead zone
  void state(StateNumbers& s);

 private:
  double static_friction_nm(double speed_rad_s) const;
  void observe_friction(const Input& input, double time_s, double dt_s);

  JointModel model_;
  CompensatorOptions options_;
  MomentumObserver observer_;
  HysteresisInverse inverse_;
  thermal::Decay decay_{};
  drive::MotorState state_{};
  drive::Workspace workspace_{};
  friction::AtTemperature reference_;
  double friction_nm_ = 0, applied_rad_ = 0, angle_rad_ = 0;
  bool fresh_ = true;
};

}  // namespace tribotwin::twin
