#pragma once

#include <span>
#include <vector>

#include <tribotwin/hil/shadow/local_fit.hpp>
#include <tribotwin/twin/simulation/scenario.hpp>

namespace tribotwin::hil {

/// The torques that the drives should have for a measured motion: rigid-body dynamics for the gear torques, the law for
/// friction, its heat for the temperature. A winding adds its heat, and the torques are then those by the current,
/// which are more than those delivered while magnets are warm. Its current is that of the expected torque; while a
/// joint stands, that of the load alone.
class Expectation {
 public:
  explicit Expectation(const twin::Scenario& scenario);

  /// The motion of every joint [rad, s], `dt_s` after the one before; 0: the first.
  void set(std::span<const Motion> motions, double dt_s);
  /// What moves the arm and the rotor [Nm, arm side].
  double rigid_nm(std::size_t drive) const { return drives_[drive].rigid_nm; }
  /// Friction to be added [Nm, arm side]: one value while the joint slides; while it stands, the range of stiction.
  double friction_low_nm(std::size_t drive) const { return drives_[drive].low_nm; }
  double friction_high_nm(std::size_t drive) const { return drives_[drive].high_nm; }
  /// Lubricant temperature.
  double temperature_degC(std::size_t drive) const;

 private:
  struct Drive {
    thermal::Rise rise;
    thermal::WindingState winding;
    double ambient_offset_K = 0, rigid_nm = 0, low_nm = 0, high_nm = 0;
  };
  void expect(std::size_t drive, double dt_s);
  /// Advances the winding and puts the torques as its current tells them; returns the power to the gear [W].
  double heat_winding(std::size_t drive, double dt_s);

  const mujoco::Model& model_;
  mujoco::DataPtr data_;
  std::vector<Drive> drives_;
  std::vector<double> gear_nm_;
};

}  // namespace tribotwin::hil
